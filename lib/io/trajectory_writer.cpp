// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/atomic_file.hpp"
#include "io/schema.hpp"
#include "io/trajectory_file.hpp"
#include "io/trajectory_layout.hpp"
#include "io/validate.hpp"
#include "io/xdmf.hpp"

#include <array>
#include <cmath>
#include <fmt/format.h>

namespace talus::io {
namespace {

constexpr hsize_t block = layout::rows_at_once;

bool ends_with_any(std::string_view text, std::initializer_list<std::string_view> ends) {
    return std::any_of(ends.begin(), ends.end(), [&](std::string_view end) { return text.ends_with(end); });
}

/// A growing column without compression: its chunks keep their size and are rewritten in place, so that what
/// was flushed stays whole while the next rows arrive.
template <class T>
hdf::Dataset create_growing(const hdf::Group& group, const std::string& name, std::string_view unit,
                            hsize_t width = 1) {
    const hdf::Dims dims = width > 1 ? hdf::Dims{0, width} : hdf::Dims{0};
    const hdf::Dims chunk = width > 1 ? hdf::Dims{block, width} : hdf::Dims{block};
    return group.create(name, hdf::file_type<T>(), dims, {.unit = unit, .chunk = chunk, .extendable = true});
}

} // namespace

std::string_view series_unit(std::string_view name) {
    const std::string_view full = name;
    name = name.substr(name.find_last_of('/') + 1);
    for (const std::string_view axis : {"_x", "_y", "_z"})
        if (name.ends_with(axis))
            name.remove_suffix(2);
    if (ends_with_any(name, {"strain", "ratio", "fraction", "error", "count", "step"}))
        return "";
    if (name == "time" || name.ends_with("_time"))
        return "s";
    if (ends_with_any(name, {"stress", "pressure"}))
        return "Pa";
    if (ends_with_any(name, {"angular_velocity"}))
        return "rad s-1";
    if (ends_with_any(name, {"velocity", "speed"}))
        return "m s-1";
    if (ends_with_any(name, {"energy", "work", "dissipation"}) ||
        full.find("energy/") != std::string_view::npos)
        return "J";
    if (ends_with_any(name, {"force"}))
        return "N";
    if (ends_with_any(name, {"torque"}))
        return "N m";
    if (ends_with_any(name, {"position", "height", "displacement", "distance", "radius", "length"}))
        return "m";
    if (ends_with_any(name, {"volume"}))
        return "m3";
    if (ends_with_any(name, {"mass"}))
        return "kg";
    return "";
}

struct TrajectoryWriter::State {
    AtomicFile output;
    TrajectoryStatic statics;
    hdf::File file;

    struct Field {
        std::string name;
        hdf::Dataset value;
    };
    struct SeriesColumn {
        std::string name;
        hdf::Dataset dataset;
        std::vector<double> rows; ///< not written yet
    };
    hdf::Dataset steps, times, edges;
    std::vector<Field> fields;
    std::vector<SeriesColumn> columns;
    struct {
        hdf::Dataset step, time, pair, position, mode;
    } breakages;
    std::vector<double> frame_times;
    std::size_t stage_count = 0;
    std::vector<float> narrow; ///< a frame on its way to f32
    bool failed = false;

    State(const std::string& path, TrajectoryStatic given, bool overwrite)
        : output(path, overwrite), statics(std::move(given)) {}

    const hdf::Context& context() const { return file.context(); }

    void create(const Provenance& provenance, const std::string& config) {
        file = create_file(output.partial(), output.path(), FileKind::trajectory, provenance, config);
        check_statics();
        const hdf::Group root = file.root();
        const hdf::Group particles = root.create_group("particles/all");
        const auto compressed = hdf::Filter::compressed;
        particles.write("radius", statics.radius, {.unit = "m", .filter = compressed});
        if (!statics.mass.empty())
            particles.write("mass", statics.mass, {.unit = "kg", .filter = compressed});
        if (!statics.species.empty())
            write_species(particles, statics.species);
        for (const auto& [name, column] : labels())
            if (!column->empty())
                particles.write(name, *column, {.filter = compressed});

        // MDAnalysis looks for edges that depend on time, so they do; step and time are those of position.
        const hdf::Group position = particles.create_group("position");
        write_origin(position, statics.origin, statics.coordinate_system);
        position.set("float64", std::int64_t{statics.float64});
        steps = create_growing<std::int64_t>(position, "step", "");
        times = create_growing<double>(position, "time", "s");
        const hdf::Group box = write_box_frame(particles, statics.box);
        const hdf::Group edge_group = timed_group(box, "edges");
        edges = create_growing<double>(edge_group, "value", "m", 3);

        root.create_group(layout::series);
        root.create_group(layout::stages);
        const hdf::Group broken = root.create_group(layout::breakages);
        breakages = {create_growing<std::int64_t>(broken, "step", ""),
                     create_growing<double>(broken, "time", "s"),
                     create_growing<std::int64_t>(broken, "pair", "", 2),
                     create_growing<double>(broken, "position", "m", 3),
                     create_growing<std::uint8_t>(broken, "mode", "")};
        file.flush();
    }

    /// Columns of a byte per particle, by their names in the file.
    std::array<std::pair<std::string, const std::vector<std::uint8_t>*>, 2> labels() const {
        return {{{"release", &statics.release}, {"material", &statics.material}}};
    }

    void check_statics() const {
        const std::size_t n = statics.size();
        const std::string where = "/particles/all/";
        check_positive(context(), where + "radius", statics.radius);
        if (!statics.mass.empty()) {
            check_length(context(), where + "mass", statics.mass.size(), n);
            check_positive(context(), where + "mass", statics.mass);
        }
        if (!statics.species.empty())
            check_length(context(), where + "species", statics.species.size(), n);
        for (const auto& [name, column] : labels())
            if (!column->empty())
                check_length(context(), where + name, column->size(), n);
    }

    /// A {step, time, value} group with step and time of position.
    hdf::Group timed_group(const hdf::Group& parent, const std::string& name) const {
        hdf::Group group = parent.create_group(name);
        const hdf::Group position = file.root().group("particles/all/position");
        for (const char* shared : {"step", "time"})
            if (!group.has(shared))
                group.link(shared, position, shared);
        return group;
    }

    void create_fields(const std::vector<TrajectoryWriter::Field>& given) {
        const hdf::Group particles = file.root().group(layout::particles);
        const std::size_t n = statics.size();
        bool position = false;
        for (const auto& [name, values] : given) {
            position |= name == "position";
            const hdf::Group group = timed_group(particles, name);
            const hid_t type = statics.float64 ? hdf::file_type<double>() : hdf::file_type<float>();
            fields.push_back({name, group.create("value", type, {0, n, 3},
                                                 {.unit = layout::field_unit(name),
                                                  .chunk = {1, layout::chunk_particles(n), 3},
                                                  .extendable = true})});
        }
        if (!position)
            context().fail("/particles/all", "a frame without positions; give the field position");
    }

    void write_frame(std::int64_t step, double time, const std::vector<TrajectoryWriter::Field>& given) {
        for (const auto& [name, values] : given) {
            const std::string place =
                fmt::format("/particles/all/{}: frame {} (step {})", name, frame_times.size(), step);
            check_length(context(), place, values.size(), statics.size());
            check_finite(context(), place, values);
        }
        if (fields.empty())
            create_fields(given);
        if (given.size() != fields.size())
            context().fail("/particles/all",
                           fmt::format("a frame with {} fields after one with {}; give the same ones "
                                       "each time",
                                       given.size(), fields.size()));
        for (std::size_t f = 0; f < fields.size(); ++f) {
            const auto& [name, values] = given[f];
            if (name != fields[f].name)
                context().fail("/particles/all",
                               fmt::format("a frame with {} where {} was; give the same fields in the "
                                           "same order",
                                           name, fields[f].name));
            if (statics.float64) {
                fields[f].value.append(values.empty() ? nullptr : &values.data()->x, 1);
            } else {
                narrow.resize(3 * values.size());
                for (std::size_t i = 0; i < values.size(); ++i)
                    for (int k = 0; k < 3; ++k)
                        narrow[3 * i + static_cast<std::size_t>(k)] = static_cast<float>(values[i][k]);
                fields[f].value.append(narrow.data(), 1);
            }
        }
        const Vec3 lengths = statics.box.lengths();
        edges.append(&lengths.x, 1);
        steps.append(&step, 1);
        times.append(&time, 1);
        frame_times.push_back(time);
        write_series();
        file.flush();
    }

    void write_series() {
        for (SeriesColumn& column : columns) {
            if (column.name == "step") {
                std::vector<std::int64_t> whole;
                for (const double v : column.rows)
                    whole.push_back(std::llround(v));
                column.dataset.append(whole.data(), whole.size());
            } else {
                column.dataset.append(column.rows.data(), column.rows.size());
            }
            column.rows.clear();
        }
    }

    void create_columns(const std::vector<std::pair<std::string, double>>& row) {
        const hdf::Group group = file.root().group(layout::series);
        bool step = false, time = false;
        for (const auto& [name, value] : row) {
            step |= name == "step";
            time |= name == "time";
            if (name.empty() || name.starts_with('/') || group.has(name))
                context().fail(group.path(name),
                               "is no name for a series column, or there twice; give another one");
            columns.push_back({name,
                               name == "step" ? create_growing<std::int64_t>(group, name, "")
                                              : create_growing<double>(group, name, series_unit(name)),
                               {}});
        }
        if (!step || !time)
            context().fail(layout::series, "a row without step or time; give both");
    }

    std::string xdmf() const {
        const std::size_t n = statics.size(), frames = frame_times.size();
        std::vector<XdmfArray> arrays;
        const auto add_field = [&](const Field& field) {
            arrays.push_back({.name = field.name,
                              .path = field.value.path(),
                              .rows = n,
                              .width = 3,
                              .precision = statics.float64 ? 8 : 4,
                              .frames = frames});
        };
        for (const Field& field : fields)
            if (field.name == "position")
                add_field(field);
        for (const Field& field : fields)
            if (field.name != "position")
                add_field(field);
        const std::string where = "/particles/all/";
        arrays.push_back({.name = "radius", .path = where + "radius", .rows = n});
        if (!statics.mass.empty())
            arrays.push_back({.name = "mass", .path = where + "mass", .rows = n});
        if (!statics.species.empty())
            arrays.push_back(
                {.name = "species", .path = where + "species", .rows = n, .number = "UChar", .precision = 1});
        for (const auto& [name, column] : labels())
            if (!column->empty())
                arrays.push_back(
                    {.name = name, .path = where + name, .rows = n, .number = "UChar", .precision = 1});
        return xdmf_points(output.path(), "particles", arrays, frame_times);
    }

    /// Runs a step of writing; after a failure nothing more is written and the file goes.
    template <class Step>
    void guarded(Step step) {
        if (failed)
            throw Error(ExitCode::run_failed,
                        fmt::format("{}: is no longer written after an earlier failure", output.path()));
        try {
            step();
        } catch (...) {
            failed = true;
            output.abandon();
            throw;
        }
    }
};

TrajectoryWriter::TrajectoryWriter(const std::string& path, TrajectoryStatic statics,
                                   const Provenance& provenance, const std::string& config, bool overwrite)
    : state_(std::make_unique<State>(path, std::move(statics), overwrite)) {
    state_->create(provenance, config);
}

TrajectoryWriter::~TrajectoryWriter() = default;
TrajectoryWriter::TrajectoryWriter(TrajectoryWriter&&) noexcept = default;

void TrajectoryWriter::frame(std::int64_t step, double time, const std::vector<Field>& fields) {
    state_->guarded([&] { state_->write_frame(step, time, fields); });
}

void TrajectoryWriter::series(const std::vector<std::pair<std::string, double>>& row) {
    State& s = *state_;
    s.guarded([&] {
        if (s.columns.empty())
            s.create_columns(row);
        if (row.size() != s.columns.size())
            s.context().fail(layout::series,
                             fmt::format("a row of {} values for {} columns; give all of them each time",
                                         row.size(), s.columns.size()));
        for (std::size_t c = 0; c < row.size(); ++c) {
            if (row[c].first != s.columns[c].name)
                s.context().fail(layout::series,
                                 fmt::format("a row with {} where {} was; give the same columns in the "
                                             "same order",
                                             row[c].first, s.columns[c].name));
            s.columns[c].rows.push_back(row[c].second);
        }
        if (s.columns.front().rows.size() >= layout::rows_at_once) {
            s.write_series();
            s.file.flush();
        }
    });
}

void TrajectoryWriter::bond_breakages(std::span<const BondBreakage> breakages) {
    State& s = *state_;
    s.guarded([&] {
        std::vector<std::int64_t> step, pair;
        std::vector<double> time, position;
        std::vector<std::uint8_t> mode;
        for (const BondBreakage& b : breakages) {
            step.push_back(b.step);
            time.push_back(b.time);
            pair.insert(pair.end(), {b.i, b.j});
            position.insert(position.end(), {b.position.x, b.position.y, b.position.z});
            mode.push_back(b.mode);
        }
        s.breakages.step.append(step.data(), step.size());
        s.breakages.time.append(time.data(), step.size());
        s.breakages.pair.append(pair.data(), step.size());
        s.breakages.position.append(position.data(), step.size());
        s.breakages.mode.append(mode.data(), step.size());
    });
}

void TrajectoryWriter::stage(const StageMark& mark) {
    State& s = *state_;
    s.guarded([&] {
        const hdf::Group group =
            s.file.root().create_group(fmt::format("{}/{:04}", layout::stages, s.stage_count++));
        group.set("name", mark.name);
        group.set("step", mark.step);
        group.set("time", mark.time);
    });
}

void TrajectoryWriter::flush() {
    State& s = *state_;
    s.guarded([&] {
        s.write_series();
        s.file.flush();
    });
}

void TrajectoryWriter::suspend() {
    State& s = *state_;
    s.guarded([&] {
        s.write_series();
        s.file.flush();
        s.file.close();
        s.output.leave();
    });
}

void TrajectoryWriter::finish() {
    State& s = *state_;
    s.guarded([&] {
        s.write_series();
        AtomicFile sidecar(sidecar_path(s.output.path()), true);
        sidecar.write(s.xdmf());
        complete_and_close(s.file);
        s.output.commit();
        sidecar.commit();
    });
}

} // namespace talus::io
