// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/checkpoint_file.hpp"

#include "base/error.hpp"
#include "io/atomic_file.hpp"
#include "io/schema.hpp"

#include <filesystem>
#include <fmt/format.h>
#include <utility>

namespace talus::io {
namespace {

template <class T>
bool read_if(const hdf::Dataset& dataset, Column::Data& data) {
    if (!dataset.stored_as<T>())
        return false;
    data = dataset.read<T>();
    return true;
}

/// The column's data in the type that the file holds.
template <class... T>
void read_data(const hdf::Dataset& dataset, std::variant<std::vector<T>...>& data) {
    if (!(read_if<T>(dataset, data) || ...))
        dataset.context().fail(dataset.path(),
                               "has a type that checkpoints do not use; write the checkpoint anew");
}

void write_column(const hdf::Group& group, const Column& column) {
    std::visit(
        [&]<class T>(const std::vector<T>& data) {
            if (column.width == 0 || data.size() % column.width != 0)
                group.context().fail(group.path(column.name),
                                     fmt::format("{} values are no rows of {}", data.size(), column.width));
            hdf::Dims dims{data.size() / column.width};
            if (column.width > 1)
                dims.push_back(column.width);
            // Floating point numbers hardly shrink and would take most of the time.
            const auto filter = std::is_floating_point_v<T> ? hdf::Filter::checksum : hdf::Filter::compressed;
            group.write(column.name, data.data(), dims, {.unit = column.unit, .filter = filter});
        },
        column.data);
}

} // namespace

const Column* CheckpointFile::find(const std::string& name) const {
    for (const Column& column : columns)
        if (column.name == name)
            return &column;
    return nullptr;
}

void CheckpointFile::refuse(const std::string& name, bool present) {
    throw Error(
        ExitCode::input_invalid,
        fmt::format("checkpoint: column {}: {}; start anew from the model", name,
                    present ? "has another type than this version of the program writes" : "is missing"));
}

std::string previous_checkpoint(const std::string& path) {
    return path + ".prev";
}

void write_checkpoint(const std::string& path, const CheckpointFile& file) {
    AtomicFile output(path, true);
    hdf::File to = create_file(output.partial(), path, FileKind::checkpoint, file.provenance, file.config);
    {
        const hdf::Group group = to.root().create_group("granular/checkpoint");
        group.set(file.attributes);
        std::vector<std::string> names;
        for (const Column& column : file.columns) {
            write_column(group, column);
            names.push_back(column.name);
        }
        to.root().group("granular").write_texts("checkpoint_columns", names);
    }
    complete_and_close(to);
    output.commit(previous_checkpoint(path));
}

CheckpointFile read_checkpoint(const std::string& path) {
    const hdf::File from = open_file(path, FileKind::checkpoint);
    const hdf::Group granular = from.root().group("granular");
    const hdf::Group group = granular.group("checkpoint");
    CheckpointFile file;
    file.attributes = group.attributes();
    for (const std::string& name : granular.read_texts("checkpoint_columns")) {
        Column& column = file.columns.emplace_back();
        column.name = name;
        const hdf::Dataset dataset = group.dataset(name);
        const hdf::Dims dims = dataset.dims();
        column.width = dims.size() > 1 ? dims[1] : 1;
        column.unit = hdf::attribute_text(group, name, "unit").value_or("");
        read_data(dataset, column.data);
    }
    file.config = read_config(from);
    file.provenance = read_provenance(from);
    return file;
}

std::string usable_checkpoint(const std::string& path) {
    for (const std::string& candidate : {path, previous_checkpoint(path)}) {
        std::error_code ignored;
        if (!std::filesystem::exists(candidate, ignored))
            continue;
        try {
            if (kind_of(candidate) == FileKind::checkpoint) {
                check_all(candidate);
                return candidate;
            }
        } catch (const Error&) {
            // a damaged one is no place to resume from
        }
    }
    return "";
}

} // namespace talus::io
