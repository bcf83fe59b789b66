// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/pgbox_file.hpp"

#include "io/atomic_file.hpp"
#include "io/schema.hpp"
#include "io/validate.hpp"

#include <numbers>

namespace talus::io {
namespace {

/// 4/3 pi r^3 density of each grain, kg.
std::vector<double> sphere_masses(const PgBox& box) {
    std::vector<double> mass(box.radius.size());
    for (std::size_t i = 0; i < mass.size(); ++i)
        mass[i] = 4.0 / 3.0 * std::numbers::pi * box.radius[i] * box.radius[i] * box.radius[i] * box.density;
    return mass;
}

void write_grading(const hdf::Group& pgbox, const std::string& name, const GradingColumns& grading) {
    if (grading.diameter.size() != grading.fraction_finer.size())
        pgbox.context().fail(pgbox.path(name), "has columns of different length");
    if (grading.diameter.empty())
        return;
    pgbox.write(name + "/diameter", grading.diameter, {.unit = "m"});
    pgbox.write(name + "/fraction_finer", grading.fraction_finer);
}

GradingColumns read_grading(const hdf::Group& pgbox, const std::string& name) {
    if (!pgbox.is_group(name))
        return {};
    const hdf::Group group = pgbox.group(name);
    GradingColumns out{read_scalars(group, "diameter"), read_scalars(group, "fraction_finer")};
    if (out.diameter.size() != out.fraction_finer.size())
        pgbox.context().fail(pgbox.path(name), "has columns of different length; make the box anew");
    return out;
}

} // namespace

void write_pgbox(const std::string& path, const PgBoxFile& file, bool overwrite) {
    AtomicFile output(path, overwrite);
    hdf::File to = create_file(output.partial(), path, FileKind::pgbox, file.provenance, file.config);
    check_pgbox(to.context(), "/particles/all", file.box);
    {
        const hdf::Group root = to.root();
        const hdf::Group particles = root.create_group("particles/all");
        write_box(particles, file.box.box());
        write_vectors(particles, "position", file.box.position, "m");
        particles.write("radius", file.box.radius, {.unit = "m", .filter = hdf::Filter::compressed});
        particles.write("mass", sphere_masses(file.box), {.unit = "kg", .filter = hdf::Filter::compressed});
        write_contacts(root, file.box.contacts);

        const hdf::Group pgbox = root.create_group("granular/pgbox");
        pgbox.set(file.attributes);
        pgbox.set("density", file.box.density);
        write_grading(pgbox, "grading", file.grading);
        write_grading(pgbox, "grading/asked", file.asked_grading);
        for (const auto& [name, values] : file.history) {
            if (values.size() != file.history.front().second.size())
                to.context().fail(pgbox.path("history/" + name), "differs in length from the other columns");
            pgbox.write("history/" + name, values, {.filter = hdf::Filter::compressed});
        }
        if (!file.history.empty()) {
            std::vector<std::string> names;
            for (const auto& column : file.history)
                names.push_back(column.first);
            pgbox.group("history").set("columns", names);
        }
    }
    complete_and_close(to);
    output.commit();
}

PgBoxFile read_pgbox(const std::string& path) {
    const hdf::File from = open_file(path, FileKind::pgbox);
    const hdf::Group root = from.root();
    const hdf::Group particles = root.group("particles/all");
    PgBoxFile file;
    file.box.position = read_vectors(particles, "position");
    file.box.radius = read_scalars(particles, "radius");
    file.box.contacts = read_contacts(root);
    const auto box = read_box(particles);
    if (!box)
        from.context().fail("/particles/all/box/edges", "is missing; a PG box needs its edge lengths");
    const Vec3 edges = box->lengths();
    if (edges.x != edges.y || edges.x != edges.z || box->lower != Vec3{} ||
        box->periodic != std::array{true, true, true})
        from.context().fail("/particles/all/box",
                            "is no periodic cube with its lower corner at the origin; make the "
                            "box anew");
    file.box.length = edges.x;
    if (root.is_group("granular/pgbox")) {
        const hdf::Group pgbox = root.group("granular/pgbox");
        file.attributes = pgbox.attributes();
        file.attributes.erase("density");
        file.box.density = pgbox.number("density").value_or(file.box.density);
        file.grading = read_grading(pgbox, "grading");
        file.asked_grading = read_grading(pgbox, "grading/asked");
        if (pgbox.is_group("history")) {
            const hdf::Group history = pgbox.group("history");
            for (const std::string& name : history.texts("columns"))
                file.history.emplace_back(name, read_scalars(history, name));
        }
    }
    check_pgbox(from.context(), "/particles/all", file.box);
    file.provenance = read_provenance(from);
    file.config = read_config(from);
    return file;
}

} // namespace talus::io
