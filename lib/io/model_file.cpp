// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/model_file.hpp"

#include "io/atomic_file.hpp"
#include "io/schema.hpp"
#include "io/tiled_columns.hpp"
#include "io/validate.hpp"
#include "io/xdmf.hpp"

#include <tuple>
#include <utility>

namespace talus::io {
namespace {

constexpr auto compressed = hdf::Filter::compressed;

std::string write_explicit(const hdf::File& to, const std::string& path, const Grains& grains) {
    check_grains(to.context(), grains);
    const hdf::Group root = to.root();
    const hdf::Group particles = root.create_group("particles/all");
    const std::string where = "/particles/all/";
    const std::size_t n = grains.size();
    if (grains.box)
        write_box(particles, *grains.box);
    write_vectors(particles, "position", grains.position, "m");
    write_origin(particles.dataset("position"), grains.origin, grains.coordinate_system);
    particles.write("radius", grains.radius, {.unit = "m", .filter = compressed});
    std::vector<XdmfArray> shown = {{.name = "position", .path = where + "position", .rows = n, .width = 3},
                                    {.name = "radius", .path = where + "radius", .rows = n}};
    if (!grains.mass.empty()) {
        particles.write("mass", grains.mass, {.unit = "kg", .filter = compressed});
        shown.push_back({.name = "mass", .path = where + "mass", .rows = n});
    }
    if (!grains.velocity.empty()) {
        write_vectors(particles, "velocity", grains.velocity, "m s-1");
        shown.push_back({.name = "velocity", .path = where + "velocity", .rows = n, .width = 3});
    }
    if (!grains.angular_velocity.empty()) {
        write_vectors(particles, "angular_velocity", grains.angular_velocity, "rad s-1");
        shown.push_back(
            {.name = "angular_velocity", .path = where + "angular_velocity", .rows = n, .width = 3});
    }
    if (!grains.species.empty()) {
        write_species(particles, grains.species);
        shown.push_back(
            {.name = "species", .path = where + "species", .rows = n, .number = "UChar", .precision = 1});
    }
    for (const auto& [name, column] :
         {std::pair{"release", &grains.release}, std::pair{"material", &grains.material}})
        if (!column->empty()) {
            particles.write(name, *column, {.filter = compressed});
            shown.push_back(
                {.name = name, .path = where + name, .rows = n, .number = "UChar", .precision = 1});
        }
    if (grains.contacts.size() > 0)
        write_contacts(root, grains.contacts);
    return xdmf_points(path, "particles", shown);
}

/// Overlaps that another program's file leaves out, from the geometry.
void fill_overlaps(Grains& grains) {
    ContactTable& contacts = grains.contacts;
    if (!contacts.normal_overlap.empty() || contacts.size() == 0)
        return;
    const Vec3 edges = grains.box ? grains.box->lengths() : Vec3{};
    const auto n = static_cast<std::int64_t>(grains.size());
    contacts.normal_overlap.resize(contacts.size());
    for (std::size_t c = 0; c < contacts.size(); ++c) {
        const auto [i, j] = contacts.pair[c];
        if (i < 0 || j < 0 || i >= n || j >= n)
            continue; // refused below
        const auto a = static_cast<std::size_t>(i), b = static_cast<std::size_t>(j);
        Vec3 branch = grains.position[b] - grains.position[a];
        for (int k = 0; k < 3; ++k)
            branch[k] += contacts.image[c][static_cast<std::size_t>(k)] * edges[k];
        contacts.normal_overlap[c] = grains.radius[a] + grains.radius[b] - norm(branch);
    }
}

/// First and end of a part of n rows.
std::pair<std::uint64_t, std::uint64_t> rows_of(const Part& part, std::uint64_t n) {
    const auto rank = static_cast<std::uint64_t>(part.rank), size = static_cast<std::uint64_t>(part.size);
    const auto start = [&](std::uint64_t r) { return n / size * r + n % size * r / size; }; // r n / size
    return {start(rank), start(rank + 1)};
}

Grains read_explicit(const hdf::File& from, const Part& part, std::uint64_t& total, std::uint64_t& first) {
    const hdf::Group root = from.root();
    const hdf::Group particles = root.group("particles/all");
    total = find_element(particles, "position", 3).rows;
    std::uint64_t end = 0;
    std::tie(first, end) = rows_of(part, total);
    const RowRange rows{first, end - first};
    const auto has = [&](const char* name, std::size_t width = 1) {
        if (!particles.has(name))
            return false;
        check_length(from.context(), particles.path(name), find_element(particles, name, width).rows, total);
        return true;
    };
    Grains grains;
    grains.position = read_vectors(particles, "position", rows);
    grains.origin = read_origin(particles);
    grains.coordinate_system = hdf::attribute_text(particles, "position", "coordinate_system").value_or("");
    has("radius");
    grains.radius = read_scalars(particles, "radius", rows);
    if (has("mass"))
        grains.mass = read_scalars(particles, "mass", rows);
    if (has("velocity", 3))
        grains.velocity = read_vectors(particles, "velocity", rows);
    if (has("angular_velocity", 3))
        grains.angular_velocity = read_vectors(particles, "angular_velocity", rows);
    if (has("species"))
        grains.species = read_species(particles, rows);
    if (has("release"))
        for (const std::int32_t mark : read_integers(particles, "release", rows))
            grains.release.push_back(mark != 0);
    if (has("material"))
        grains.material = read_material(particles, rows);
    grains.box = read_box(particles);
    if (part.size == 1) {
        grains.contacts = read_contacts(root);
        fill_overlaps(grains);
    }
    check_grains(from.context(), grains, {first, total});
    return grains;
}

} // namespace

void write_model(const std::string& path, const ModelFile& file, bool overwrite) {
    AtomicFile output(path, overwrite);
    AtomicFile sidecar(sidecar_path(path), true);
    hdf::File to = create_file(output.partial(), path, FileKind::model, file.provenance, file.config);
    if (const auto* tiled = std::get_if<TiledModel>(&file.model)) {
        TiledColumns columns(to, *tiled);
        columns.add(tiled->tiles, tiled->kept_mask, tiled->fixed_mask, tiled->release_mask);
        sidecar.write(columns.finish(path));
    } else {
        sidecar.write(write_explicit(to, path, std::get<Grains>(file.model)));
    }
    complete_and_close(to);
    output.commit();
    sidecar.commit();
}

ModelFile read_model(const std::string& path, Part part) {
    const hdf::File from = open_file(path, FileKind::model);
    ModelFile file;
    if (from.root().is_group("granular/tiling")) {
        file.model = read_tiled(from);
        file.total = std::get<TiledModel>(file.model).size();
    } else {
        file.model = read_explicit(from, part, file.total, file.first);
    }
    file.provenance = read_provenance(from);
    file.config = read_config(from);
    return file;
}

} // namespace talus::io
