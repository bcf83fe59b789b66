// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/schema.hpp"

#include <fmt/format.h>

namespace talus::io {

std::string to_string(FileKind kind) {
    switch (kind) {
    case FileKind::pgbox:
        return "pgbox";
    case FileKind::model:
        return "model";
    case FileKind::trajectory:
        return "trajectory";
    case FileKind::checkpoint:
        return "checkpoint";
    }
    return "unknown";
}

namespace {

FileInfo info_of(const hdf::File& file) {
    const hdf::Group root = file.root();
    if (!root.is_group("granular"))
        file.context().fail("/granular",
                            "is missing, so this is not one of our files; give a file made by one of "
                            "these tools, or add /granular with kind and complete");
    const hdf::Group granular = root.group("granular");
    const auto kind = granular.text("kind");
    if (!kind)
        file.context().fail("/granular",
                            "has no attribute kind; set it to pgbox, model, trajectory or checkpoint");
    FileInfo info;
    info.complete = granular.integer("complete").value_or(0) == 1;
    for (const FileKind k : {FileKind::pgbox, FileKind::model, FileKind::trajectory, FileKind::checkpoint})
        if (*kind == to_string(k)) {
            info.kind = k;
            return info;
        }
    file.context().fail("/granular", fmt::format("kind is \"{}\"; pgbox, model, trajectory or checkpoint was "
                                                 "expected",
                                                 *kind));
}

const char* maker_of(FileKind kind) {
    switch (kind) {
    case FileKind::pgbox:
        return "pgbox-gen makes one";
    case FileKind::model:
        return "tile-trim makes one";
    case FileKind::trajectory:
    case FileKind::checkpoint:
        return "dem-run makes one";
    }
    return "";
}

void require_complete(const hdf::File& file, const FileInfo& info) {
    if (!info.complete)
        file.context().fail("/granular",
                            "complete is not 1: the program that wrote the file did not finish; run it "
                            "again (it resumes from its checkpoint where there is one)");
}

void require_kind(const hdf::File& file, const FileInfo& info, FileKind kind) {
    if (info.kind != kind)
        file.context().fail("/granular", fmt::format("kind is \"{}\", but a {} is needed here; {}",
                                                     to_string(info.kind), to_string(kind), maker_of(kind)));
}

void write_provenance(const hdf::Group& granular, const Provenance& provenance) {
    for (std::size_t n = 0; n < provenance.size(); ++n) {
        const ProvenanceRecord& record = provenance[n];
        const hdf::Group group = granular.create_group(fmt::format("provenance/{:04}", n));
        group.set("program", record.program);
        group.set("version", record.version);
        group.write("seed", &record.seed, {1});
        group.write_text("command_line", record.command_line);
        group.write_text("config", record.config);
        group.write_texts("inputs", record.inputs);
    }
}

void check_group(const hdf::Group& group) {
    for (const std::string& name : group.names()) {
        const std::string path = group.path(name);
        if (group.is_group(name))
            check_group(group.group(name));
        else
            group.dataset(name).check();
    }
    (void)group.attributes();
}

} // namespace

std::string library_version() {
    unsigned major = 0, minor = 0, release = 0;
    H5get_libversion(&major, &minor, &release);
    return fmt::format("{}.{}.{}", major, minor, release);
}

FileInfo inspect(const std::string& path) {
    return info_of(hdf::File::open(path));
}

FileKind kind_of(const std::string& path) {
    const hdf::File file = hdf::File::open(path);
    const FileInfo info = info_of(file);
    require_complete(file, info);
    return info.kind;
}

void check_all(const std::string& path) {
    const hdf::File file = hdf::File::open(path);
    require_complete(file, info_of(file));
    check_group(file.root());
}

hdf::File open_file(const std::string& path, FileKind kind, bool incomplete) {
    hdf::File file = hdf::File::open(path);
    const FileInfo info = info_of(file);
    require_kind(file, info, kind);
    if (!incomplete)
        require_complete(file, info);
    return file;
}

hdf::File modify_file(const std::string& partial, FileKind kind, const hdf::Writers& writers) {
    hdf::File file = hdf::File::modify(partial, writers);
    require_kind(file, info_of(file), kind);
    return file;
}

hdf::File create_file(const std::string& partial, const std::string& name, FileKind kind,
                      const Provenance& provenance, const std::string& config, const hdf::Writers& writers) {
    hdf::File file = hdf::File::create(partial, name, writers);
    const hdf::Group root = file.root();
    const std::int64_t h5md_version[] = {1, 1}, module_version[] = {1, 0};

    const hdf::Group h5md = root.create_group("h5md");
    h5md.set("version", std::span<const std::int64_t>(h5md_version));
    h5md.create_group("author").set("name",
                                    "unknown"); // H5MD asks for one; it would not be a function of the input
    const hdf::Group creator = h5md.create_group("creator");
    creator.set("name", provenance.empty() ? "talus" : provenance.back().program);
    creator.set("version", provenance.empty() ? "1.0" : provenance.back().version);
    const hdf::Group units = h5md.create_group("modules/units");
    units.set("version", std::span<const std::int64_t>(module_version));
    units.set("system", "SI");
    h5md.create_group("modules/granular").set("version", std::span<const std::int64_t>(module_version));

    const hdf::Group granular = root.create_group("granular");
    granular.set("kind", to_string(kind));
    granular.set("complete", std::int64_t{0});
    write_provenance(granular, provenance);
    root.create_group("parameters").write_text("config", config);
    return file;
}

void replace_origin(const hdf::File& file, const Provenance& provenance, const std::string& config) {
    const hdf::Group granular = file.root().group("granular"), parameters = file.root().group("parameters");
    if (granular.has("provenance"))
        granular.unlink("provenance");
    write_provenance(granular, provenance);
    parameters.unlink("config");
    parameters.write_text("config", config);
}

void complete_and_close(hdf::File& file) {
    file.flush();
    file.root().group("granular").set("complete", std::int64_t{1});
    file.flush();
    file.close();
}

Provenance read_provenance(const hdf::File& file) {
    Provenance chain;
    const hdf::Group granular = file.root().group("granular");
    if (!granular.is_group("provenance"))
        return chain;
    const hdf::Group all = granular.group("provenance");
    for (const std::string& name : all.names()) {
        const hdf::Group group = all.group(name);
        ProvenanceRecord record;
        record.program = group.text("program").value_or("");
        record.version = group.text("version").value_or("");
        for (const std::uint64_t seed : group.dataset("seed").read<std::uint64_t>())
            record.seed = seed;
        record.command_line = group.read_text("command_line");
        record.config = group.read_text("config");
        record.inputs = group.read_texts("inputs");
        chain.push_back(std::move(record));
    }
    return chain;
}

std::string read_config(const hdf::File& file) {
    const hdf::Group root = file.root();
    return root.has("parameters/config") ? root.read_text("parameters/config") : "";
}

} // namespace talus::io
