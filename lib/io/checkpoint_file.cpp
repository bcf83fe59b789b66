// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/checkpoint_file.hpp"

#include "base/error.hpp"
#include "io/atomic_file.hpp"
#include "io/schema.hpp"

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>
#include <optional>
#include <utility>

namespace talus::io {
namespace {

template <class T>
bool read_if(const hdf::Dataset& dataset, const hdf::Dims& offset, const hdf::Dims& count,
             Column::Data& data) {
    if (!dataset.stored_as<T>())
        return false;
    std::size_t size = 1;
    for (const hsize_t c : count)
        size *= c;
    std::vector<T> values(size);
    if (size > 0)
        dataset.read(values.data(), offset, count);
    data = std::move(values);
    return true;
}

/// The column's data in the type that the file holds.
template <class... T>
void read_data(const hdf::Dataset& dataset, const hdf::Dims& offset, const hdf::Dims& count,
               std::variant<std::vector<T>...>& data) {
    if (!(read_if<T>(dataset, offset, count, data) || ...))
        dataset.context().fail(dataset.path(),
                               "has a type that checkpoints do not use; write the checkpoint anew");
}

/// What a rank can see by itself before all write together.
void check_column(const hdf::Group& group, const Column& column) {
    const std::size_t size = std::visit([](const auto& data) { return data.size(); }, column.data);
    const auto refuse = [&](const std::string& what) {
        group.context().fail(group.path(column.name), what + "; this is a mistake of the program");
    };
    if (column.width == 0 || size % column.width != 0)
        refuse(fmt::format("{} values are no rows of {}", size, column.width));
    const std::uint64_t rows = size / column.width, total = column.rows.total;
    if (total > 0 && (column.rows.first > total || rows > total - column.rows.first))
        refuse(fmt::format("rows {} to {} of {}", column.rows.first, column.rows.first + rows, total));
    if (total > 0 && group.context().alone() && rows != total)
        refuse(fmt::format("{} rows of {}, written by one process", rows, total));
}

void write_column(const hdf::Group& group, const Column& column) {
    std::visit(
        [&]<class T>(const std::vector<T>& data) {
            hdf::Dims dims{data.size() / column.width};
            if (column.width > 1)
                dims.push_back(column.width);
            // Floating point numbers hardly shrink and would take most of the time.
            const auto filter = std::is_floating_point_v<T> ? hdf::Filter::checksum : hdf::Filter::compressed;
            group.write(column.name, data.data(), dims,
                        {.unit = column.unit, .filter = filter, .rows = column.rows});
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

void write_checkpoint(const std::string& path, const CheckpointFile& file, const Together& together) {
    std::optional<AtomicFile> output; // on the first rank
    std::string partial;
    all_or_none(together, [&] {
        if (together.first())
            partial = output.emplace(path, true).partial();
    });
    partial = from_first(together, partial);
    hdf::File to = create_file(partial, path, FileKind::checkpoint, file.provenance, file.config,
                               {together, output ? &*output : nullptr});
    {
        const hdf::Group group = to.root().create_group("granular/checkpoint");
        group.set(file.attributes);
        std::vector<std::string> names;
        const auto write = [&](const Column& column) {
            write_column(group, column);
            names.push_back(column.name);
        };
        const auto check = [&](const std::vector<Column>& columns) {
            all_or_none(together, [&] {
                for (const Column& column : columns)
                    check_column(group, column);
            });
        };
        check(file.columns);
        std::for_each(file.columns.begin(), file.columns.end(), write);
        for (const auto& make : file.later) {
            std::vector<Column> columns;
            all_or_none(together, [&] { columns = make(); });
            check(columns);
            for (Column& column : columns) {
                write(column);
                column.data = {};
            }
        }
        to.root().group("granular").write_texts("checkpoint_columns", names);
    }
    complete_and_close(to);
    all_or_none(together, [&] {
        if (output)
            output->commit(previous_checkpoint(path));
    });
}

struct CheckpointReader::State {
    struct Part {
        std::uint64_t first, count;
    };
    hdf::File file;
    hdf::Group group;
    std::vector<std::string> names;

    explicit State(const std::string& path)
        : file(open_file(path, FileKind::checkpoint)), group(file.root().group("granular/checkpoint")),
          names(file.root().group("granular").read_texts("checkpoint_columns")) {}

    Column read(const std::string& name, std::optional<Part> part) const {
        const hdf::Dataset dataset = group.dataset(name);
        hdf::Dims dims = dataset.dims();
        if (dims.empty() || dims.size() > 2)
            file.context().fail(dataset.path(), "is not [rows] or [rows][width]; write the checkpoint anew");
        Column column;
        column.name = name;
        column.width = dims.size() > 1 ? dims[1] : 1;
        column.unit = hdf::attribute_text(group, name, "unit").value_or("");
        hdf::Dims offset(dims.size(), 0);
        if (part) {
            if (part->first > dims[0] || part->count > dims[0] - part->first)
                file.context().fail(dataset.path(),
                                    fmt::format("has {} rows, {} to {} are needed; write the checkpoint anew",
                                                dims[0], part->first, part->first + part->count));
            column.rows = {part->first, dims[0]};
            offset[0] = part->first;
            dims[0] = part->count;
        }
        read_data(dataset, offset, dims, column.data);
        return column;
    }
};

CheckpointReader::CheckpointReader(const std::string& path) : state_(std::make_unique<State>(path)) {}
CheckpointReader::~CheckpointReader() = default;
CheckpointReader::CheckpointReader(CheckpointReader&&) noexcept = default;
CheckpointReader& CheckpointReader::operator=(CheckpointReader&&) noexcept = default;

Attributes CheckpointReader::attributes() const {
    return state_->group.attributes();
}
std::string CheckpointReader::config() const {
    return read_config(state_->file);
}
Provenance CheckpointReader::provenance() const {
    return read_provenance(state_->file);
}
const std::vector<std::string>& CheckpointReader::names() const {
    return state_->names;
}
bool CheckpointReader::has(const std::string& name) const {
    return std::find(names().begin(), names().end(), name) != names().end();
}
std::uint64_t CheckpointReader::rows(const std::string& name) const {
    const hdf::Dims dims = state_->group.dataset(name).dims();
    return dims.empty() ? 0 : dims[0];
}
std::size_t CheckpointReader::width(const std::string& name) const {
    const hdf::Dims dims = state_->group.dataset(name).dims();
    return dims.size() > 1 ? dims[1] : 1;
}
Column CheckpointReader::read(const std::string& name) const {
    return state_->read(name, std::nullopt);
}
Column CheckpointReader::read(const std::string& name, std::uint64_t first, std::uint64_t count) const {
    return state_->read(name, State::Part{first, count});
}

CheckpointFile read_checkpoint(const std::string& path) {
    const CheckpointReader from(path);
    CheckpointFile file;
    file.attributes = from.attributes();
    for (const std::string& name : from.names())
        file.columns.push_back(from.read(name));
    file.config = from.config();
    file.provenance = from.provenance();
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
