// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/schema.hpp"

#include <fmt/format.h>
#include <type_traits>

namespace talus::io {

// Columns of vectors and index tuples are written from memory as they are, without a copy.
static_assert(sizeof(Vec3) == 3 * sizeof(double) && std::is_standard_layout_v<Vec3>);
static_assert(sizeof(std::array<std::int64_t, 2>) == 2 * sizeof(std::int64_t));
static_assert(sizeof(std::array<std::int8_t, 3>) == 3);

namespace {

constexpr auto compressed = hdf::Filter::compressed;

bool is_time_dependent(const hdf::Group& group, const std::string& name) {
    return group.is_group(name);
}

std::string shape_of(const hdf::Dims& dims) {
    std::string text;
    for (const hsize_t d : dims)
        text += fmt::format("[{}]", d);
    return text.empty() ? "a scalar" : text;
}

/// The element with only these rows of it.
Element part_of(Element element, const SomeRows& rows, std::size_t width) {
    if (!rows)
        return element;
    if (rows->first > element.rows || rows->count > element.rows - rows->first)
        element.dataset.context().fail(
            element.dataset.path(), fmt::format("has {} rows, {} to {} are needed; write one row a particle",
                                                element.rows, rows->first, rows->first + rows->count));
    if (element.offset.empty()) { // all of it
        element.count = element.dataset.dims();
        element.offset.assign(element.count.size(), 0);
    }
    const std::size_t dimension = element.count.size() - (width > 1 ? 2 : 1);
    element.offset[dimension] = rows->first;
    element.count[dimension] = rows->count;
    element.rows = rows->count;
    return element;
}

template <class T>
std::vector<T> read_column(const hdf::Group& group, const std::string& name, const SomeRows& rows) {
    const Element element = part_of(find_element(group, name, 1), rows, 1);
    std::vector<T> values(element.rows);
    if (element.rows > 0)
        element.dataset.read(values.data(), element.offset, element.count);
    return values;
}

} // namespace

Element find_element(const hdf::Group& group, const std::string& name, std::size_t width) {
    const bool timed = is_time_dependent(group, name);
    Element element;
    element.dataset = timed ? group.group(name).dataset("value") : group.dataset(name);
    hdf::Dims dims = element.dataset.dims();
    const std::size_t own = width > 1 ? 2 : 1; // dimensions without time
    if (timed && dims.size() == own + 1) {
        if (dims[0] == 0)
            group.context().fail(element.dataset.path(), "has no frame; write at least one");
        element.offset.assign(dims.size(), 0);
        element.offset[0] = dims[0] - 1;
        element.count = dims;
        element.count[0] = 1;
        dims.erase(dims.begin());
    }
    if (dims.size() != own || (width > 1 && dims[1] != width))
        group.context().fail(element.dataset.path(),
                             fmt::format("has shape {}; [N]{} was expected", shape_of(dims),
                                         width > 1 ? fmt::format("[{}]", width) : ""));
    element.rows = dims[0];
    return element;
}

std::vector<Vec3> read_vectors(const hdf::Group& group, const std::string& name, SomeRows rows) {
    const Element element = part_of(find_element(group, name, 3), rows, 3);
    std::vector<Vec3> values(element.rows);
    if (element.rows > 0)
        element.dataset.read(&values.data()->x, element.offset, element.count);
    return values;
}

std::vector<double> read_scalars(const hdf::Group& group, const std::string& name, SomeRows rows) {
    return read_column<double>(group, name, rows);
}

std::vector<std::int32_t> read_integers(const hdf::Group& group, const std::string& name, SomeRows rows) {
    return read_column<std::int32_t>(group, name, rows);
}

std::vector<Species> read_species(const hdf::Group& group, SomeRows rows) {
    const std::vector<std::int32_t> numbers = read_integers(group, "species", rows);
    const std::uint64_t first = rows ? rows->first : 0;
    std::vector<Species> species(numbers.size());
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        if (numbers[i] < 0 || numbers[i] > 2)
            group.context().fail(
                group.path("species"),
                fmt::format("row {} is {}; 0 (grain), 1 (fixed) or 2 (membrane) was expected", first + i,
                            numbers[i]));
        species[i] = static_cast<Species>(numbers[i]);
    }
    return species;
}

std::vector<std::uint8_t> read_material(const hdf::Group& group, SomeRows rows) {
    const std::vector<std::int32_t> numbers = read_integers(group, "material", rows);
    const std::uint64_t first = rows ? rows->first : 0;
    std::vector<std::uint8_t> material(numbers.size());
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        if (numbers[i] < 0 || numbers[i] > 255)
            group.context().fail(group.path("material"),
                                 fmt::format("row {} is {}; the number of a material, 0 to 255, was expected",
                                             first + i, numbers[i]));
        material[i] = static_cast<std::uint8_t>(numbers[i]);
    }
    return material;
}

ContactTable read_contacts(const hdf::Group& root) {
    ContactTable contacts;
    if (!root.has("connectivity/contacts"))
        return contacts;
    const Element pairs = find_element(root, "connectivity/contacts", 2);
    contacts.pair.resize(pairs.rows);
    contacts.image.assign(pairs.rows, {0, 0, 0});
    if (pairs.rows > 0)
        pairs.dataset.read(contacts.pair.data()->data(), pairs.offset, pairs.count);
    if (root.has("granular/contacts/image")) {
        const Element images = find_element(root, "granular/contacts/image", 3);
        if (images.rows != pairs.rows)
            root.context().fail(images.dataset.path(),
                                fmt::format("has {} rows, {} has {}; write one row a contact", images.rows,
                                            pairs.dataset.path(), pairs.rows));
        if (images.rows > 0)
            images.dataset.read(contacts.image.data()->data(), images.offset, images.count);
    }
    if (root.has("granular/contacts/normal_overlap"))
        contacts.normal_overlap = read_scalars(root, "granular/contacts/normal_overlap");
    if (root.has("granular/contacts/tangential_displacement"))
        contacts.tangential_displacement = read_vectors(root, "granular/contacts/tangential_displacement");
    return contacts;
}

std::optional<Box> read_box(const hdf::Group& particles) {
    if (!particles.has("box/edges"))
        return std::nullopt;
    const hdf::Group group = particles.group("box");
    const bool timed = group.is_group("edges");
    const hdf::Dataset dataset = timed ? group.group("edges").dataset("value") : group.dataset("edges");
    std::vector<double> edges = dataset.read<double>();
    const std::size_t rank = dataset.dims().size() - (timed ? 1 : 0);
    if (rank == 2 && edges.size() >= 9) // a cuboid as a matrix
        edges = {edges[edges.size() - 9], edges[edges.size() - 5], edges[edges.size() - 1]};
    if (edges.size() < 3)
        group.context().fail(dataset.path(), "has no three edge lengths; write [3] numbers in m");
    Box box;
    const std::vector<double> lower = group.numbers("lower");
    if (lower.size() == 3)
        box.lower = {lower[0], lower[1], lower[2]};
    const std::vector<double> upper = group.numbers("upper");
    if (upper.size() == 3)
        box.upper = {upper[0], upper[1], upper[2]};
    else
        box.upper =
            box.lower + Vec3{edges[edges.size() - 3], edges[edges.size() - 2], edges[edges.size() - 1]};
    for (int k = 0; k < 3; ++k)
        if (!(box.upper[k] > box.lower[k]) || !is_finite(box.upper - box.lower))
            group.context().fail(dataset.path(),
                                 "has an edge that is not a positive number; write lengths in m");
    const std::vector<std::string> boundary = group.texts("boundary");
    for (std::size_t k = 0; k < 3 && k < boundary.size(); ++k)
        box.periodic[k] = boundary[k] == "periodic";
    return box;
}

Vec3 read_origin(const hdf::Group& particles) {
    const std::vector<double> origin = hdf::attribute_numbers(particles, "position", "origin");
    const Vec3 point = origin.size() == 3 ? Vec3{origin[0], origin[1], origin[2]} : Vec3{};
    if (!is_finite(point))
        particles.context().fail(particles.path("position"),
                                 "attribute origin is not finite; write three numbers in m");
    return point;
}

void write_vectors(const hdf::Group& group, const std::string& name, const std::vector<Vec3>& values,
                   std::string_view unit) {
    group.write(name, values.empty() ? nullptr : &values.data()->x, {values.size(), 3}, {.unit = unit});
}

void write_species(const hdf::Group& group, const std::vector<Species>& species, Rows rows) {
    group.write("species", reinterpret_cast<const std::uint8_t*>(species.data()), {species.size()},
                {.filter = compressed, .rows = rows});
}

void link_to_particles(const hdf::Group& root, const hdf::Dataset& pairs) {
    hobj_ref_t reference{};
    const hdf::Id space(H5Screate(H5S_SCALAR), H5Sclose);
    const hdf::Id attribute(
        H5Acreate2(pairs.id(), "particles_group", H5T_STD_REF_OBJ, space, H5P_DEFAULT, H5P_DEFAULT),
        H5Aclose);
    if (H5Rcreate(&reference, root.id(), "/particles/all", H5R_OBJECT, -1) < 0 ||
        H5Awrite(attribute, H5T_STD_REF_OBJ, &reference) < 0)
        root.context().fail_hdf(pairs.path(), "linked to its particles");
}

void write_contacts(const hdf::Group& root, const ContactTable& contacts) {
    const std::size_t n = contacts.size();
    const hdf::Dataset pairs =
        root.write("connectivity/contacts", reinterpret_cast<const std::int64_t*>(contacts.pair.data()),
                   {n, 2}, {.filter = compressed});
    if (root.is_group("particles/all"))
        link_to_particles(root, pairs);
    root.write("granular/contacts/image", reinterpret_cast<const std::int8_t*>(contacts.image.data()), {n, 3},
               {.filter = compressed});
    root.write("granular/contacts/normal_overlap", contacts.normal_overlap, {.unit = "m"});
    if (!contacts.tangential_displacement.empty())
        write_vectors(root, "granular/contacts/tangential_displacement", contacts.tangential_displacement,
                      "m");
}

hdf::Group write_box_frame(const hdf::Group& particles, const Box& box) {
    hdf::Group group = particles.create_group("box");
    group.set("dimension", std::int64_t{3});
    std::vector<std::string> boundary;
    for (const bool periodic : box.periodic)
        boundary.emplace_back(periodic ? "periodic" : "none");
    group.set("boundary", boundary);
    group.set("lower", std::span<const double>(&box.lower.x, 3));
    group.set("upper", std::span<const double>(&box.upper.x, 3));
    return group;
}

void write_box(const hdf::Group& particles, const Box& box) {
    const Vec3 edges = box.lengths();
    write_box_frame(particles, box).write("edges", &edges.x, {3}, {.unit = "m"});
}

} // namespace talus::io
