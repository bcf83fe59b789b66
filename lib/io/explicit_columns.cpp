// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/explicit_columns.hpp"

#include "io/atomic_file.hpp"
#include "io/schema.hpp"
#include "io/validate.hpp"
#include "io/xdmf.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <utility>
#include <vector>

namespace talus::io {
namespace {

constexpr auto compressed = hdf::Filter::compressed;
constexpr auto checksum = hdf::Filter::checksum;

} // namespace

ExplicitColumns::ExplicitColumns(const hdf::File& to, const ExplicitFrame& frame, ThreadTeam& team)
    : frame_(frame), root_(to.root()), particles_(root_.create_group("particles/all")), press_(team),
      position_(particles_, "position", "m", checksum, 3, &press_),
      radius_(particles_, "radius", "m", compressed, 1, &press_),
      species_(particles_, "species", "", compressed, 1, &press_),
      release_(particles_, "release", "", compressed, 1, &press_),
      material_(particles_, "material", "", compressed, 1, &press_),
      pair_(root_, "connectivity/contacts", "", compressed, 2, &press_),
      image_(root_, "granular/contacts/image", "", compressed, 3, &press_),
      overlap_(root_, "granular/contacts/normal_overlap", "m", checksum, 1, &press_) {
    if (!is_finite(frame.origin))
        to.context().fail("/particles/all/position", "the origin is not finite; give three numbers in m");
    if (frame.box)
        write_box(particles_, *frame.box);
}

void ExplicitColumns::add(const Grains& grains) {
    const std::string group = "/particles/all/";
    const hdf::Context& context = root_.context();
    const std::size_t n = grains.size();
    check_finite(context, group + "position", grains.position, count_);
    check_length(context, group + "radius", grains.radius.size(), n);
    check_positive(context, group + "radius", grains.radius, count_);
    if (n > 0)
        position_.append(&grains.position.data()->x, n);
    radius_.append(grains.radius.data(), n);
    if (frame_.species) {
        check_length(context, group + "species", grains.species.size(), n);
        species_.append(reinterpret_cast<const std::uint8_t*>(grains.species.data()), n);
    }
    if (frame_.release) {
        check_length(context, group + "release", grains.release.size(), n);
        release_.append(grains.release.data(), n);
    }
    if (frame_.material) {
        check_length(context, group + "material", grains.material.size(), n);
        material_.append(grains.material.data(), n);
    }
    const ContactTable& contacts = grains.contacts;
    const std::size_t m = contacts.size();
    if (contacts.image.size() != m || contacts.normal_overlap.size() != m)
        context.fail("/connectivity/contacts",
                     fmt::format("contacts have {} pairs, {} images and {} overlaps; write one of each a "
                                 "contact",
                                 m, contacts.image.size(), contacts.normal_overlap.size()));
    const auto first = static_cast<std::int64_t>(count_), end = static_cast<std::int64_t>(count_ + n);
    for (std::size_t c = 0; c < m; ++c) {
        const auto [i, j] = contacts.pair[c];
        if (i < first || i >= end || i >= j || !std::isfinite(contacts.normal_overlap[c]))
            context.fail("/connectivity/contacts",
                         fmt::format("contact {} joins {} and {} with the overlap {}; {} <= i < {}, i < j "
                                     "and a finite overlap are needed",
                                     contacts_ + c, i, j, contacts.normal_overlap[c], first, end));
        largest_partner_ = std::max(largest_partner_, j);
    }
    if (m > 0) {
        pair_.append(contacts.pair.data()->data(), m);
        image_.append(contacts.image.data()->data(), m);
        overlap_.append(contacts.normal_overlap.data(), m);
    }
    press_.flush();
    count_ += n;
    contacts_ += m;
}

std::string ExplicitColumns::finish(const std::string& path) {
    const hdf::Context& context = root_.context();
    if (count_ == 0)
        context.fail("/particles/all/position", "holds no particle; a model needs at least one");
    if (largest_partner_ >= static_cast<std::int64_t>(count_))
        context.fail("/connectivity/contacts",
                     fmt::format("a contact names particle {}, there are {}", largest_partner_, count_));
    const std::string where = "/particles/all/";
    write_origin(position_.finish(), frame_.origin, frame_.coordinate_system);
    radius_.finish();
    std::vector<XdmfArray> shown = {
        {.name = "position", .path = where + "position", .rows = count_, .width = 3},
        {.name = "radius", .path = where + "radius", .rows = count_}};
    const auto mark = [&](const char* name, StreamedColumn<std::uint8_t>& column) {
        column.finish();
        shown.push_back(
            {.name = name, .path = where + name, .rows = count_, .number = "UChar", .precision = 1});
    };
    if (frame_.species)
        mark("species", species_);
    if (frame_.release)
        mark("release", release_);
    if (frame_.material)
        mark("material", material_);
    if (contacts_ > 0) {
        link_to_particles(root_, pair_.finish());
        image_.finish();
        overlap_.finish();
    }
    return xdmf_points(path, "particles", shown);
}

struct ExplicitWriter::State {
    AtomicFile output, sidecar;
    hdf::File to;
    ExplicitColumns columns;

    State(const std::string& path, const ExplicitFrame& frame, const Provenance& provenance,
          const std::string& config, bool overwrite, ThreadTeam& team)
        : output(path, overwrite), sidecar(sidecar_path(path), true),
          to(create_file(output.partial(), path, FileKind::model, provenance, config)),
          columns(to, frame, team) {}
};

ExplicitWriter::ExplicitWriter(const std::string& path, const ExplicitFrame& frame,
                               const Provenance& provenance, const std::string& config, bool overwrite,
                               ThreadTeam& team)
    : state_(std::make_unique<State>(path, frame, provenance, config, overwrite, team)) {}

ExplicitWriter::~ExplicitWriter() = default;

ExplicitFileSize explicit_file_size(const Grains& grains, const ExplicitFrame& frame,
                                    const Provenance& provenance, const std::string& config,
                                    ThreadTeam& team) {
    hdf::Writers nowhere;
    nowhere.in_memory = true;
    const hdf::File to = create_file("size", "size", FileKind::model, provenance, config, nowhere);
    ExplicitColumns columns(to, frame, team);
    columns.add(grains);
    columns.finish("size");
    to.flush();
    const auto stored = [root = to.root()](const char* name) {
        return root.has(name) ? root.dataset(name).stored_size() : std::uint64_t{0};
    };
    ExplicitFileSize size;
    for (const char* name :
         {"particles/all/radius", "particles/all/species", "particles/all/release", "particles/all/material"})
        size.compressed_particles += stored(name);
    for (const char* name : {"connectivity/contacts", "granular/contacts/image"})
        size.compressed_contacts += stored(name);
    size.others = to.length() - size.compressed_particles - size.compressed_contacts -
                  stored("particles/all/position") - stored("granular/contacts/normal_overlap");
    return size;
}

std::uint64_t ExplicitFileSize::plain(std::uint64_t particles, std::uint64_t contacts) {
    return StreamedColumn<double>::plain_bytes(particles, 3) +
           StreamedColumn<double>::plain_bytes(contacts, 1);
}

void ExplicitWriter::add(const Grains& grains) {
    state_->columns.add(grains);
}

void ExplicitWriter::finish() {
    state_->sidecar.write(state_->columns.finish(state_->output.path()));
    complete_and_close(state_->to);
    state_->output.commit();
    state_->sidecar.commit();
}

} // namespace talus::io
