// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/schema.hpp"
#include "io/trajectory_file.hpp"
#include "io/trajectory_layout.hpp"
#include "io/validate.hpp"
#include "io/wall_maps.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <map>

namespace talus::io {

struct TrajectoryReader::State {
    hdf::File file;
    TrajectoryStatic statics;
    bool complete = false;
    struct Frame {
        std::int64_t step;
        double time;
        std::size_t full;    ///< its place among the full frames
        std::string changes; ///< or the group of its changes
    };
    std::vector<Frame> frames;
    std::size_t full_frames = 0;
    struct Kept {
        std::size_t frame = 0;
        std::vector<Vec3> rows;
    };
    mutable std::map<std::string, Kept> kept; ///< by field: what was read last, where there are changes

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
        const auto steps = position.dataset("step").read<std::int64_t>();
        const auto times = position.dataset("time").read<double>();
        full_frames = std::min(steps.size(), times.size());
        bool any = false;
        for (const std::string& name : names()) {
            const hdf::Dataset value = particles().dataset(name + "/value");
            const hdf::Dims dims = value.dims();
            if (dims.size() != 3 || dims[1] != statics.size() || dims[2] != 3)
                context().fail(value.path(), fmt::format("is not [frames][{}][3]; make the trajectory anew",
                                                         statics.size()));
            full_frames = std::min<std::size_t>(full_frames, dims[0]);
            any = true;
        }
        if (!any)
            full_frames = 0;
        for (std::size_t k = 0; k < full_frames; ++k)
            frames.push_back({steps[k], times[k], k, {}});
        const hdf::Group root = file.root();
        if (!root.has(layout::changes) || full_frames == 0)
            return;
        const hdf::Group changes = root.group(layout::changes);
        for (const std::string& name : changes.names()) {
            const hdf::Group group = changes.group(name);
            const auto step = group.integer("step");
            const auto time = group.number("time");
            if (!step || !time || !group.integer("count"))
                break; // a killed run began it
            if (*step < frames.front().step)
                context().fail(group.path(), "stands before the first full frame; make the trajectory anew");
            frames.push_back({*step, *time, 0, name});
        }
        // At the end of a stage changes come before the next one's first frame, of the same step.
        std::stable_sort(frames.begin(), frames.end(), [](const Frame& a, const Frame& b) {
            return a.step < b.step || (a.step == b.step && !a.changes.empty() && b.changes.empty());
        });
    }

    std::vector<Vec3> read_full(std::size_t full, const std::string& field) const {
        const hdf::Dataset value = particles().dataset(field + "/value");
        const std::size_t n = statics.size();
        std::vector<Vec3> rows(n);
        read_rows(value, {full, 0, 0}, {1, n, 3}, rows);
        return rows;
    }

    void read_rows(const hdf::Dataset& value, const hdf::Dims& offset, const hdf::Dims& count,
                   std::vector<Vec3>& rows) const {
        const std::size_t n = rows.size();
        if (n > 0 && value.stored_as<float>()) {
            std::vector<float> narrow(3 * n);
            value.read(narrow.data(), offset, count);
            for (std::size_t i = 0; i < n; ++i)
                rows[i] = {narrow[3 * i], narrow[3 * i + 1], narrow[3 * i + 2]};
        } else if (n > 0) {
            value.read(&rows.data()->x, offset, count);
        }
    }

    /// Puts the changes of a frame in their places.
    void apply(const Frame& frame, const std::string& field, std::vector<Vec3>& rows) const {
        const hdf::Group group = file.root().group(layout::changes).group(frame.changes);
        if (group.integer("count") == 0)
            return;
        const auto particle = group.dataset("particle").read<std::uint64_t>();
        const hdf::Dataset value = group.dataset(field);
        if (value.dims() != hdf::Dims{particle.size(), 3})
            context().fail(value.path(),
                           fmt::format("is not [{}][3]; make the trajectory anew", particle.size()));
        std::vector<Vec3> changed(particle.size());
        read_rows(value, {0, 0}, {particle.size(), 3}, changed);
        for (std::size_t k = 0; k < particle.size(); ++k) {
            if (particle[k] >= rows.size())
                context().fail(group.path("particle"),
                               fmt::format("names particle {} of {}; make the trajectory anew", particle[k],
                                           rows.size()));
            rows[particle[k]] = changed[k];
        }
    }

    std::vector<Vec3> read(std::size_t frame, const std::string& field) const {
        if (frames[frame].changes.empty() && full_frames == frames.size())
            return read_full(frames[frame].full, field);
        std::size_t base = frame;
        while (!frames[base].changes.empty())
            --base;
        Kept& last = kept[field];
        std::size_t next = last.frame + 1;
        if (last.rows.empty() || last.frame < base || last.frame > frame) {
            last.rows = read_full(frames[base].full, field);
            next = base + 1;
        }
        for (; next <= frame; ++next)
            apply(frames[next], field, last.rows);
        last.frame = frame;
        return last.rows;
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
    return state_->frames.size();
}
double TrajectoryReader::time(std::size_t frame) const {
    return state_->frames.at(frame).time;
}
std::int64_t TrajectoryReader::step(std::size_t frame) const {
    return state_->frames.at(frame).step;
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
    std::vector<Vec3> rows = s.read(frame, field);
    check_finite(s.context(), fmt::format("{}: frame {}", value.path(), frame), rows);
    return rows;
}

std::size_t TrajectoryReader::full_frames() const {
    return state_->full_frames;
}

std::vector<double> TrajectoryReader::column(const std::string& name) const {
    const hdf::Group particles = state_->particles();
    if (!particles.has(name) || particles.is_group(name))
        return {};
    std::vector<double> values = particles.dataset(name).read<double>();
    check_length(state_->context(), particles.path(name), values.size(), state_->statics.size());
    return values;
}

std::optional<double> TrajectoryReader::column_attribute(const std::string& name,
                                                         const std::string& attribute) const {
    const hdf::Group particles = state_->particles();
    if (!particles.has(name) || particles.is_group(name))
        return std::nullopt;
    const std::vector<double> values = hdf::attribute_numbers(particles, name, attribute);
    return values.empty() ? std::nullopt : std::optional<double>(values.front());
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

std::vector<WallMap> TrajectoryReader::walls() const {
    return read_walls(state_->file.root());
}

Provenance TrajectoryReader::provenance() const {
    return read_provenance(state_->file);
}
std::string TrajectoryReader::config() const {
    return read_config(state_->file);
}

} // namespace talus::io
