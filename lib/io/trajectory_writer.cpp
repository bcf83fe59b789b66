// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/atomic_file.hpp"
#include "io/growing_column.hpp"
#include "io/schema.hpp"
#include "io/trajectory_file.hpp"
#include "io/trajectory_layout.hpp"
#include "io/validate.hpp"
#include "io/wall_maps.hpp"
#include "io/xdmf.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <functional>
#include <optional>

namespace talus::io {
namespace {

/// Brings `items` (as a file lists them) into the order of `given`; what is not in `given` goes to the end.
template <class Item, class Given>
void order_as(std::vector<Item>& items, const std::vector<Given>& given) {
    const auto place = [&](const Item& item) {
        return std::find_if(given.begin(), given.end(), [&](const Given& g) { return g.first == item.name; });
    };
    std::stable_sort(items.begin(), items.end(),
                     [&](const Item& a, const Item& b) { return place(a) < place(b); });
}

} // namespace

struct TrajectoryWriter::State {
    std::string path;
    Together together;
    Rows rows;                        ///< of this rank
    std::optional<AtomicFile> output; ///< on the first rank
    TrajectoryStatic statics;
    std::string static_columns; ///< which optional ones any rank has: " mass species "
    hdf::File file;

    struct Field {
        std::string name;
        hdf::Dataset value;
    };
    struct SeriesColumn {
        std::string name;
        Growing stored;
        std::vector<double> rows; ///< not written yet
    };
    Growing steps, times, edges;
    std::vector<Field> fields;
    std::vector<SeriesColumn> columns;
    struct {
        Growing step, time, pair, position, mode;
    } breakages;
    std::vector<double> frame_times;
    std::size_t stage_count = 0, change_count = 0;
    std::vector<XdmfArray> own_columns; ///< written by column()
    std::string walls_xdmf;             ///< of the walls with patches
    std::vector<Extent> lasting;        ///< bytes of the file that never change again
    std::vector<float> narrow;          ///< a frame on its way to f32
    bool failed = false;
    bool resumed = false;                                     ///< fields and columns are the file's
    bool fields_unordered = false, columns_unordered = false; ///< ... and in no given order yet
    bool kept = false;                                        ///< a checkpoint may need the unfinished file

    State(const std::string& name, TrajectoryStatic given, const Together& ranks, Rows part)
        : path(name), together(ranks), rows(part), statics(std::move(given)) {
        if (rows.total == 0)
            rows = {0, statics.size()};
    }

    ~State() { drop(); }

    /// Ends without a whole file.
    void drop() noexcept {
        if (output && kept)
            output->leave();
        output.reset();
    }

    const hdf::Context& context() const { return file.context(); }

    /// Runs `open` on the first rank; returns the partial file's name.
    std::string open_output(const std::function<void()>& open) {
        std::string partial;
        all_or_none(together, [&] {
            if (!together.first())
                return;
            open();
            partial = output->partial();
        });
        return from_first(together, partial);
    }

    hdf::Writers writers() { return {together, output ? &*output : nullptr}; }

    void create(const Provenance& provenance, const std::string& config, bool overwrite) {
        const std::string partial = open_output([&] { output.emplace(path, overwrite); });
        file = create_file(partial, path, FileKind::trajectory, provenance, config, writers());
        agree_on_statics();
        const hdf::Group root = file.root();
        const hdf::Group particles = root.create_group("particles/all");
        const auto compressed = hdf::Filter::compressed;
        particles.write("radius", statics.radius, {.unit = "m", .filter = compressed, .rows = rows});
        if (present("mass"))
            particles.write("mass", statics.mass, {.unit = "kg", .filter = compressed, .rows = rows});
        if (present("species"))
            write_species(particles, statics.species, rows);
        for (const auto& [name, column] : labels())
            if (present(name))
                particles.write(name, *column, {.filter = compressed, .rows = rows});

        // MDAnalysis looks for edges that depend on time, so they do; step and time are those of position.
        const hdf::Group position = particles.create_group("position");
        write_origin(position, statics.origin, statics.coordinate_system);
        position.set("float64", std::int64_t{statics.float64});
        steps = Growing::create<std::int64_t>(position, "step", "");
        times = Growing::create<double>(position, "time", "s");
        const hdf::Group box = write_box_frame(particles, statics.box);
        const hdf::Group edge_group = timed_group(box, "edges");
        edges = Growing::create<double>(edge_group, "value", "m", 3);

        root.create_group(layout::series);
        root.create_group(layout::stages);
        const hdf::Group broken = root.create_group(layout::breakages);
        breakages = {Growing::create<std::int64_t>(broken, "step", ""),
                     Growing::create<double>(broken, "time", "s"),
                     Growing::create<std::int64_t>(broken, "pair", "", 2),
                     Growing::create<double>(broken, "position", "m", 3),
                     Growing::create<std::uint8_t>(broken, "mode", "")};
        file.flush();
        for (const char* name : {"radius", "mass", "species", "release", "material"})
            if (particles.has(name))
                find_chunks(particles.dataset(name));
    }

    void find_chunks(const hdf::Dataset& dataset) {
        const hdf::Dims whole = dataset.dims();
        dataset.find_chunks(hdf::Dims(whole.size(), 0), whole, lasting);
    }

    void go_on(const TrajectoryImage& image, const Provenance& provenance, const std::string& config,
               bool overwrite) {
        kept = resumed = fields_unordered = columns_unordered = true;
        const std::string partial = open_output([&] {
            output.emplace(AtomicFile::take_over(path, overwrite));
            restore(*output, image);
        });
        lasting = complement(image.ranges, image.length);
        file = modify_file(partial, FileKind::trajectory, writers());
        agree_on_statics();
        const hdf::Group root = file.root();
        const hdf::Group particles = root.group(layout::particles);
        const hdf::Group position = particles.group("position");
        check_same_particles(particles);
        steps = Growing::open(position, "step");
        times = Growing::open(position, "time");
        edges = Growing::open(particles, "box/edges/value");
        frame_times = times.dataset.read<double>();
        for (const std::string& name : particles.names())
            if (name != "box" && particles.is_group(name) && particles.has(name + "/value"))
                fields.push_back({name, particles.dataset(name + "/value")});
        for (const Field& field : fields)
            if (field.value.dims() != hdf::Dims{frame_times.size(), rows.total, 3})
                context().fail(field.value.path(),
                               fmt::format("is not [{}][{}][3]; start anew from the model",
                                           frame_times.size(), rows.total));
        const hdf::Group series = root.group(layout::series);
        std::vector<std::string> names;
        layout::collect_names(series, "", names);
        for (const std::string& name : names)
            columns.push_back({name, Growing::open(series, name), {}});
        stage_count = root.group(layout::stages).names().size();
        if (root.has(layout::changes))
            change_count = root.group(layout::changes).names().size();
        const hdf::Group broken = root.group(layout::breakages);
        breakages = {Growing::open(broken, "step"), Growing::open(broken, "time"),
                     Growing::open(broken, "pair"), Growing::open(broken, "position"),
                     Growing::open(broken, "mode")};
        file.now_written(path);
        replace_origin(file, provenance, config);
    }

    void check_same_particles(const hdf::Group& particles) const {
        const std::size_t n = find_element(particles, "radius", 1).rows;
        if (n != rows.total)
            context().fail(
                "/particles/all/radius",
                fmt::format("has {} rows, the model {}; resume with the model it began with", n, rows.total));
        for (const char* name : {"mass", "species", "release", "material"})
            if (particles.has(name) != present(name))
                context().fail(particles.path(name),
                               present(name) ? "is missing; resume with the model it began with"
                                             : "is not in the model; resume with the one it began with");
        if ((particles.group("position").integer("float64").value_or(0) == 1) != statics.float64)
            context().fail("/particles/all/position",
                           "has another precision; resume with the output.float64 it began with");
    }

    /// Columns of a byte per particle, by their names in the file.
    std::array<std::pair<std::string, const std::vector<std::uint8_t>*>, 2> labels() const {
        return {{{"release", &statics.release}, {"material", &statics.material}}};
    }

    /// Collective: checks this rank's rows; a rank without particles learns which columns the others have.
    void agree_on_statics() {
        std::string own = statics.size() > 0 ? " " : "";
        if (!statics.mass.empty())
            own += "mass ";
        if (!statics.species.empty())
            own += "species ";
        for (const auto& [name, column] : labels())
            if (!column->empty())
                own += name + " ";
        static_columns = together.agree(own);
        all_or_none(together, [&] { check_statics(); });
    }

    bool present(const std::string& column) const {
        return static_columns.find(" " + column + " ") != std::string::npos;
    }

    void check_statics() const {
        const std::size_t n = statics.size();
        const std::string where = "/particles/all/";
        if (rows.first > rows.total || n > rows.total - rows.first)
            context().fail(where + "radius",
                           fmt::format("rows {} to {} of {}; this is a mistake of the program", rows.first,
                                       rows.first + n, rows.total));
        check_positive(context(), where + "radius", statics.radius, rows.first);
        if (present("mass")) {
            check_length(context(), where + "mass", statics.mass.size(), n);
            check_positive(context(), where + "mass", statics.mass, rows.first);
        }
        if (present("species"))
            check_length(context(), where + "species", statics.species.size(), n);
        for (const auto& [name, column] : labels())
            if (present(name))
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
        bool position = false;
        for (const auto& [name, values] : given)
            position |= name == "position";
        if (!position)
            context().fail("/particles/all", "a frame without positions; give the field position");
        const hsize_t n = rows.total;
        const hsize_t chunk = together.alone() ? layout::chunk_particles(n)
                                               : std::clamp<hsize_t>(n, 1, layout::shared_chunk_particles);
        for (const auto& [name, values] : given) {
            const hdf::Group group = timed_group(particles, name);
            const hid_t type = statics.float64 ? hdf::file_type<double>() : hdf::file_type<float>();
            fields.push_back(
                {name, group.create(
                           "value", type, {0, n, 3},
                           {.unit = layout::field_unit(name), .chunk = {1, chunk, 3}, .extendable = true})});
        }
    }

    /// What is given must be what is there; a resumed file was begun by another run, with its settings.
    [[noreturn]] void misfit(const std::string& place, const std::string& what, const char* things) const {
        if (resumed)
            throw Error(ExitCode::input_invalid,
                        fmt::format("{}: {}: {}; resume with the output settings that it began with", path,
                                    place, what));
        context().fail(place, fmt::format("{}; give the same {} each time, in the same order", what, things));
    }

    void check_frame(std::int64_t step, const std::vector<TrajectoryWriter::Field>& given) const {
        for (const auto& [name, values] : given) {
            const std::string place =
                fmt::format("/particles/all/{}: frame {} (step {})", name, frame_times.size(), step);
            check_length(context(), place, values.size(), statics.size());
            check_finite(context(), place, values, rows.first);
        }
    }

    void write_frame(std::int64_t step, double time, const std::vector<TrajectoryWriter::Field>& given) {
        all_or_none(together, [&] { check_frame(step, given); });
        if (fields.empty())
            create_fields(given);
        if (std::exchange(fields_unordered, false))
            order_as(fields, given);
        if (given.size() != fields.size())
            misfit("/particles/all",
                   fmt::format("a frame with {} fields after one with {}", given.size(), fields.size()),
                   "fields");
        for (std::size_t f = 0; f < fields.size(); ++f)
            if (given[f].first != fields[f].name)
                misfit("/particles/all",
                       fmt::format("a frame with {} where {} was", given[f].first, fields[f].name), "fields");
        const std::size_t frame = frame_times.size();
        for (std::size_t f = 0; f < fields.size(); ++f) {
            const auto& values = given[f].second;
            if (statics.float64) {
                fields[f].value.append_part(values.empty() ? nullptr : &values.data()->x, rows.first,
                                            values.size());
            } else {
                narrow.resize(3 * values.size());
                for (std::size_t i = 0; i < values.size(); ++i)
                    for (int k = 0; k < 3; ++k)
                        narrow[3 * i + static_cast<std::size_t>(k)] = static_cast<float>(values[i][k]);
                fields[f].value.append_part(narrow.data(), rows.first, values.size());
            }
        }
        const Vec3 lengths = statics.box.lengths();
        edges.append(&lengths.x, 1);
        steps.append(&step, 1);
        times.append(&time, 1);
        frame_times.push_back(time);
        flush();
        for (const Field& field : fields)
            field.value.find_chunks({frame, 0, 0}, {1, rows.total, 3}, lasting);
    }

    void check_changes(std::int64_t step, std::span<const std::uint64_t> particles,
                       const std::vector<TrajectoryWriter::Field>& given) const {
        const std::string place = fmt::format("{}: step {}", layout::changes, step);
        for (std::size_t k = 0; k < particles.size(); ++k)
            if (particles[k] >= rows.total || (k > 0 && particles[k] <= particles[k - 1]))
                context().fail(place, fmt::format("particle {} of {} out of place; give them in order",
                                                  particles[k], rows.total));
        if (fields.empty() || given.size() != fields.size())
            context().fail(place, fmt::format("{} fields after a frame with {}; give those of the frame "
                                              "before",
                                              given.size(), fields.size()));
        for (std::size_t f = 0; f < given.size(); ++f) {
            const auto& [name, values] = given[f];
            if (std::none_of(fields.begin(), fields.end(),
                             [&](const Field& have) { return have.name == name; }))
                context().fail(place,
                               fmt::format("the field {}, which no frame had before; give its fields", name));
            check_length(context(), place + ": " + name, values.size(), particles.size());
            check_finite(context(), place + ": " + name, values, rows.first);
        }
    }

    void write_changes(std::int64_t step, double time, std::span<const std::uint64_t> particles,
                       const std::vector<TrajectoryWriter::Field>& given, Rows part) {
        all_or_none(together, [&] { check_changes(step, particles, given); });
        if (part.total == 0)
            part = {0, particles.size()};
        const hdf::Group group =
            file.root().create_group(fmt::format("{}/{:08}", layout::changes, change_count++));
        std::vector<hdf::Dataset> written;
        if (part.total > 0) {
            written.push_back(group.write("particle", particles.data(), {particles.size()},
                                          {.filter = hdf::Filter::compressed, .rows = part}));
            for (const auto& [name, values] : given) {
                const hdf::Layout layout{.unit = layout::field_unit(name), .rows = part};
                if (statics.float64) {
                    written.push_back(group.write(name, values.empty() ? nullptr : &values.data()->x,
                                                  {values.size(), 3}, layout));
                    continue;
                }
                narrow.resize(3 * values.size());
                for (std::size_t i = 0; i < values.size(); ++i)
                    for (int k = 0; k < 3; ++k)
                        narrow[3 * i + static_cast<std::size_t>(k)] = static_cast<float>(values[i][k]);
                written.push_back(group.write(name, narrow.data(), {values.size(), 3}, layout));
            }
        }
        group.set("step", step);
        group.set("time", time);
        group.set("count", static_cast<std::int64_t>(part.total)); // last: a reader asks for it first
        flush();
        for (const hdf::Dataset& dataset : written)
            find_chunks(dataset);
    }

    template <class T>
    void write_column(const std::string& name, std::string_view unit, std::span<const T> values,
                      const std::vector<std::pair<std::string, double>>& attributes) {
        const std::string place = std::string(layout::particles) + "/" + name;
        all_or_none(together, [&] { check_length(context(), place, values.size(), statics.size()); });
        XdmfArray array{.name = name, .path = place, .rows = rows.total};
        if (sizeof(T) == 1) {
            array.number = "UChar";
            array.precision = 1;
        }
        own_columns.push_back(array);
        const hdf::Group particles = file.root().group(layout::particles);
        if (resumed && particles.has(name))
            return;
        const hdf::Dataset dataset =
            particles.write(name, values.data(), {values.size()},
                            {.unit = unit, .filter = hdf::Filter::compressed, .rows = rows});
        for (const auto& [key, value] : attributes)
            dataset.set(key, std::span<const double>(&value, 1));
        flush();
        find_chunks(dataset);
    }

    void flush() {
        write_series();
        file.flush();
        for (Growing* column : {&steps, &times, &edges, &breakages.step, &breakages.time, &breakages.pair,
                                &breakages.position, &breakages.mode})
            column->find_full(lasting);
        for (SeriesColumn& column : columns)
            column.stored.find_full(lasting);
    }

    void write_series() {
        for (SeriesColumn& column : columns) {
            if (column.name == "step") {
                std::vector<std::int64_t> whole;
                for (const double v : column.rows)
                    whole.push_back(std::llround(v));
                column.stored.append(whole.data(), whole.size());
            } else {
                column.stored.append(column.rows.data(), column.rows.size());
            }
            column.rows.clear();
        }
    }

    void write_breakages(std::span<const BondBreakage> list) {
        std::uint64_t count = list.size();
        together.broadcast(&count, sizeof count);
        if (count == 0)
            return;
        std::vector<std::int64_t> step, pair;
        std::vector<double> time, position;
        std::vector<std::uint8_t> mode;
        if (together.first())
            for (const BondBreakage& b : list) {
                step.push_back(b.step);
                time.push_back(b.time);
                pair.insert(pair.end(), {b.i, b.j});
                position.insert(position.end(), {b.position.x, b.position.y, b.position.z});
                mode.push_back(b.mode);
            }
        breakages.step.append(step.data(), count);
        breakages.time.append(time.data(), count);
        breakages.pair.append(pair.data(), count);
        breakages.position.append(position.data(), count);
        breakages.mode.append(mode.data(), count);
    }

    TrajectoryImage image() {
        flush();
        TrajectoryImage image;
        all_or_none(together, [&] {
            if (output)
                image = capture(*output, lasting);
        });
        std::uint64_t sizes[] = {image.length, image.ranges.size(), image.bytes.size()};
        together.broadcast(sizes, sizeof sizes);
        image.length = sizes[0];
        image.ranges.resize(sizes[1]);
        image.bytes.resize(sizes[2]);
        together.broadcast(image.ranges.data(), image.ranges.size() * sizeof(Extent));
        together.broadcast(image.bytes.data(), image.bytes.size());
        kept = true;
        return image;
    }

    void finish() {
        write_series();
        complete_and_close(file);
        all_or_none(together, [&] {
            if (!output)
                return;
            AtomicFile sidecar(sidecar_path(path), true);
            sidecar.write(xdmf());
            if (!walls_xdmf.empty()) {
                AtomicFile walls(walls_sidecar_path(path), true);
                walls.write(walls_xdmf);
                walls.commit();
            }
            sidecar.commit(); // first: a run killed in between goes on and makes it again
            output->commit();
        });
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
                               name == "step" ? Growing::create<std::int64_t>(group, name, "")
                                              : Growing::create<double>(group, name, series_unit(name)),
                               {}});
        }
        if (!step || !time)
            context().fail(layout::series, "a row without step or time; give both");
    }

    std::string xdmf() const {
        const std::size_t n = rows.total, frames = frame_times.size();
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
        if (present("mass"))
            arrays.push_back({.name = "mass", .path = where + "mass", .rows = n});
        if (present("species"))
            arrays.push_back(
                {.name = "species", .path = where + "species", .rows = n, .number = "UChar", .precision = 1});
        for (const auto& [name, column] : labels())
            if (present(name))
                arrays.push_back(
                    {.name = name, .path = where + name, .rows = n, .number = "UChar", .precision = 1});
        arrays.insert(arrays.end(), own_columns.begin(), own_columns.end());
        return xdmf_points(path, "particles", arrays, frame_times);
    }

    /// Runs a step of writing; after a failure nothing more is written and the file goes.
    template <class Step>
    void guarded(Step step) {
        if (failed)
            throw Error(ExitCode::run_failed,
                        fmt::format("{}: is no longer written after an earlier failure", path));
        try {
            step();
        } catch (...) {
            failed = true;
            drop();
            throw;
        }
    }
};

TrajectoryWriter::TrajectoryWriter(const std::string& path, TrajectoryStatic statics,
                                   const Provenance& provenance, const std::string& config, bool overwrite,
                                   const Together& together, Rows rows)
    : TrajectoryWriter(std::make_unique<State>(path, std::move(statics), together, rows)) {
    state_->create(provenance, config, overwrite);
}

TrajectoryWriter TrajectoryWriter::resume(const std::string& path, const TrajectoryImage& image,
                                          TrajectoryStatic statics, const Provenance& provenance,
                                          const std::string& config, bool overwrite, const Together& together,
                                          Rows rows) {
    TrajectoryWriter writer(std::make_unique<State>(path, std::move(statics), together, rows));
    writer.state_->go_on(image, provenance, config, overwrite);
    return writer;
}

TrajectoryWriter::TrajectoryWriter(std::unique_ptr<State> state) : state_(std::move(state)) {}
TrajectoryWriter::~TrajectoryWriter() = default;
TrajectoryWriter::TrajectoryWriter(TrajectoryWriter&&) noexcept = default;

void TrajectoryWriter::frame(std::int64_t step, double time, const std::vector<Field>& fields) {
    state_->guarded([&] { state_->write_frame(step, time, fields); });
}

void TrajectoryWriter::changes(std::int64_t step, double time, std::span<const std::uint64_t> particles,
                               const std::vector<Field>& fields, Rows rows) {
    state_->guarded([&] { state_->write_changes(step, time, particles, fields, rows); });
}

void TrajectoryWriter::column(const std::string& name, std::string_view unit, std::span<const double> values,
                              const std::vector<std::pair<std::string, double>>& attributes) {
    state_->guarded([&] { state_->write_column(name, unit, values, attributes); });
}

void TrajectoryWriter::column(const std::string& name, std::span<const std::uint8_t> values) {
    state_->guarded([&] { state_->write_column(name, "", values, {}); });
}

void TrajectoryWriter::series(const std::vector<std::pair<std::string, double>>& row) {
    State& s = *state_;
    s.guarded([&] {
        if (s.columns.empty())
            s.create_columns(row);
        if (std::exchange(s.columns_unordered, false))
            order_as(s.columns, row);
        if (row.size() != s.columns.size())
            s.misfit(layout::series,
                     fmt::format("a row of {} values for {} columns", row.size(), s.columns.size()),
                     "columns");
        for (std::size_t c = 0; c < row.size(); ++c) {
            if (row[c].first != s.columns[c].name)
                s.misfit(layout::series,
                         fmt::format("a row with {} where {} was", row[c].first, s.columns[c].name),
                         "columns");
            s.columns[c].rows.push_back(row[c].second);
        }
        if (s.columns.front().rows.size() >= layout::rows_at_once)
            s.flush();
    });
}

void TrajectoryWriter::bond_breakages(std::span<const BondBreakage> breakages) {
    state_->guarded([&] { state_->write_breakages(breakages); });
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

void TrajectoryWriter::walls(std::span<const WallMap> walls) {
    State& s = *state_;
    s.guarded([&] {
        write_walls(s.file.root(), walls);
        s.walls_xdmf = xdmf_walls(s.path, walls);
    });
}

std::string walls_sidecar_path(const std::string& trajectory) {
    std::string path = sidecar_path(trajectory);
    return path.insert(path.rfind(".xdmf"), ".walls");
}

void TrajectoryWriter::flush() {
    state_->guarded([&] { state_->flush(); });
}

TrajectoryImage TrajectoryWriter::image() {
    TrajectoryImage image;
    state_->guarded([&] { image = state_->image(); });
    return image;
}

void TrajectoryWriter::suspend() {
    State& s = *state_;
    s.guarded([&] {
        s.flush();
        s.file.close();
        if (s.output)
            s.output->leave();
    });
}

void TrajectoryWriter::finish() {
    state_->guarded([&] { state_->finish(); });
}

} // namespace talus::io
