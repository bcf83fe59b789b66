// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/schema.hpp"
#include "io/trajectory_file.hpp"
#include "io/trajectory_layout.hpp"
#include "io/validate.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace talus::io {

struct TrajectoryReader::State {
    hdf::File file;
    TrajectoryStatic statics;
    bool complete = false;
    std::vector<std::int64_t> steps;
    std::vector<double> times;

    const hdf::Context& context() const { return file.context(); }
    hdf::Group particles() const { return file.root().group(layout::particles); }

    void open(const std::string& path, Accept accept) {
        file = open_file(path, FileKind::trajectory, accept == Accept::incomplete);
        complete = file.root().group("granular").integer("complete").value_or(0) == 1;
        const hdf::Group group = particles();
        const hdf::Group position = group.group("position");
        statics.radius = read_scalars(group, "radius");
        check_positive(context(), "/particles/all/radius", statics.radius);
        const std::size_t n = statics.size();
        if (group.has("mass")) {
            statics.mass = read_scalars(group, "mass");
            check_length(context(), "/particles/all/mass", statics.mass.size(), n);
            check_positive(context(), "/particles/all/mass", statics.mass);
        }
        if (group.has("species")) {
            statics.species = read_species(group);
            check_length(context(), "/particles/all/species", statics.species.size(), n);
        }
        if (group.has("release")) {
            for (const std::int32_t mark : read_integers(group, "release"))
                statics.release.push_back(mark != 0);
            check_length(context(), "/particles/all/release", statics.release.size(), n);
        }
        if (group.has("material")) {
            statics.material = read_material(group);
            check_length(context(), "/particles/all/material", statics.material.size(), n);
        }
        statics.origin = read_origin(group);
        statics.coordinate_system = position.text("coordinate_system").value_or("");
        statics.float64 = position.integer("float64").value_or(0) == 1;
        if (group.is_group("box"))
            read_corners(group.group("box"));
        read_frames(position);
    }

    void read_corners(const hdf::Group& box) {
        const std::vector<double> lower = box.numbers("lower"), upper = box.numbers("upper");
        if (lower.size() == 3 && upper.size() == 3)
            statics.box = {{lower[0], lower[1], lower[2]}, {upper[0], upper[1], upper[2]}, {}};
        const std::vector<std::string> boundary = box.texts("boundary");
        for (std::size_t k = 0; k < std::min<std::size_t>(3, boundary.size()); ++k)
            statics.box.periodic[k] = boundary[k] == "periodic";
    }

    /// Frames that are there in every field: a killed run may have begun one more in some.
    void read_frames(const hdf::Group& position) {
        steps = position.dataset("step").read<std::int64_t>();
        times = position.dataset("time").read<double>();
        std::size_t frames = std::min(steps.size(), times.size());
        bool any = false;
        for (const std::string& name : names()) {
            const hdf::Dataset value = particles().dataset(name + "/value");
            const hdf::Dims dims = value.dims();
            if (dims.size() != 3 || dims[1] != statics.size() || dims[2] != 3)
                context().fail(value.path(), fmt::format("is not [frames][{}][3]; make the trajectory anew",
                                                         statics.size()));
            frames = std::min<std::size_t>(frames, dims[0]);
            any = true;
        }
        if (!any)
            frames = 0;
        steps.resize(frames);
        times.resize(frames);
    }

    std::vector<std::string> names() const {
        std::vector<std::string> names;
        const hdf::Group group = particles();
        for (const std::string& name : group.names())
            if (name != "box" && group.is_group(name) && group.has(name + "/value"))
                names.push_back(name);
        return names;
    }
};

TrajectoryReader::TrajectoryReader(const std::string& path, Accept accept)
    : state_(std::make_unique<State>()) {
    state_->open(path, accept);
}
TrajectoryReader::~TrajectoryReader() = default;
TrajectoryReader::TrajectoryReader(TrajectoryReader&&) noexcept = default;
TrajectoryReader& TrajectoryReader::operator=(TrajectoryReader&&) noexcept = default;

const TrajectoryStatic& TrajectoryReader::statics() const {
    return state_->statics;
}
bool TrajectoryReader::complete() const {
    return state_->complete;
}
std::size_t TrajectoryReader::frames() const {
    return state_->times.size();
}
double TrajectoryReader::time(std::size_t frame) const {
    return state_->times.at(frame);
}
std::int64_t TrajectoryReader::step(std::size_t frame) const {
    return state_->steps.at(frame);
}
std::vector<std::string> TrajectoryReader::fields() const {
    return state_->names();
}

bool TrajectoryReader::has(const std::string& field) const {
    const auto names = state_->names();
    return std::find(names.begin(), names.end(), field) != names.end();
}

std::vector<Vec3> TrajectoryReader::read(std::size_t frame, const std::string& field) const {
    const State& s = *state_;
    if (!has(field))
        s.context().fail("/particles/all/" + field,
                         "is missing; run again with this field among output.fields");
    const hdf::Dataset value = s.particles().dataset(field + "/value");
    if (frame >= frames())
        s.context().fail(value.path(),
                         fmt::format("has no frame {}; its frames are 0 to {}", frame, frames()));
    const std::size_t n = s.statics.size();
    std::vector<Vec3> rows(n);
    const hdf::Dims offset{frame, 0, 0}, count{1, n, 3};
    if (n > 0 && value.stored_as<float>()) {
        std::vector<float> narrow(3 * n);
        value.read(narrow.data(), offset, count);
        for (std::size_t i = 0; i < n; ++i)
            rows[i] = {narrow[3 * i], narrow[3 * i + 1], narrow[3 * i + 2]};
    } else if (n > 0) {
        value.read(&rows.data()->x, offset, count);
    }
    check_finite(s.context(), fmt::format("{}: frame {}", value.path(), frame), rows);
    return rows;
}

std::vector<StageMark> TrajectoryReader::stages() const {
    std::vector<StageMark> marks;
    const hdf::Group root = state_->file.root();
    if (!root.has(layout::stages))
        return marks;
    const hdf::Group all = root.group(layout::stages);
    for (const std::string& name : all.names()) {
        const hdf::Group group = all.group(name);
        marks.push_back({group.text("name").value_or(""), group.integer("step").value_or(0),
                         group.number("time").value_or(0)});
    }
    return marks;
}

std::vector<std::string> TrajectoryReader::series_names() const {
    std::vector<std::string> names;
    const hdf::Group root = state_->file.root();
    if (root.has(layout::series))
        layout::collect_names(root.group(layout::series), "", names);
    std::sort(names.begin(), names.end());
    return names;
}

std::vector<double> TrajectoryReader::series(const std::string& name) const {
    const hdf::Group root = state_->file.root();
    if (!root.has(layout::series))
        state_->context().fail(layout::series, "is missing; run again with output.series_interval set");
    const hdf::Group group = root.group(layout::series);
    if (!group.has(name) || group.is_group(name))
        state_->context().fail(group.path(name),
                               "is missing; run again with a scene that records this series");
    return group.dataset(name).read<double>();
}

std::vector<BondBreakage> TrajectoryReader::bond_breakages() const {
    std::vector<BondBreakage> list;
    const hdf::Group root = state_->file.root();
    if (!root.has(layout::breakages))
        return list;
    const hdf::Group group = root.group(layout::breakages);
    const auto step = group.dataset("step").read<std::int64_t>();
    const auto time = group.dataset("time").read<double>();
    const auto pair = group.dataset("pair").read<std::int64_t>();
    const auto position = group.dataset("position").read<double>();
    const auto mode = group.dataset("mode").read<std::uint8_t>();
    const std::size_t n =
        std::min({step.size(), time.size(), pair.size() / 2, position.size() / 3, mode.size()});
    for (std::size_t b = 0; b < n; ++b)
        list.push_back({step[b],
                        time[b],
                        pair[2 * b],
                        pair[2 * b + 1],
                        {position[3 * b], position[3 * b + 1], position[3 * b + 2]},
                        mode[b]});
    return list;
}

Provenance TrajectoryReader::provenance() const {
    return read_provenance(state_->file);
}
std::string TrajectoryReader::config() const {
    return read_config(state_->file);
}

} // namespace talus::io
