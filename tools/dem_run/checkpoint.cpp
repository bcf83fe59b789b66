// SPDX-License-Identifier: GPL-3.0-or-later
#include "dem_run/checkpoint.hpp"

#include "base/error.hpp"
#include "dem_run/columns.hpp"

#include <array>
#include <nlohmann/json.hpp>

namespace talus::dem_run {

namespace {

/// Which rows of a column: those of this rank's block, its share of a table, or all of it on every rank.
enum class Spread { block, table, whole };

/// Reads rows [first, first + count) of a column that may be empty.
template <class Scalar, class Value>
void read_rows(const io::CheckpointReader& file, const std::string& name, std::uint64_t first,
               std::uint64_t count, std::vector<Value>& values) {
    const bool empty = file.rows(name) == 0;
    from_column<Scalar>(empty ? file.read(name) : file.read(name, first, count), values);
}

/// Two lists of all columns, used both ways: `each(name, values, scalar, unit, spread)`.
template <class State, class Each>
void particle_columns(State& s, Each&& each) {
    const Spread block = Spread::block;
    each("particles/position", s.position, double{}, "m", block);
    each("particles/half_velocity", s.half_velocity, double{}, "m s-1", block);
    each("particles/half_angular_velocity", s.half_angular_velocity, double{}, "rad s-1", block);
    each("particles/acceleration", s.acceleration, double{}, "m s-2", block);
    each("particles/angular_acceleration", s.angular_acceleration, double{}, "rad s-2", block);
    each("particles/damping_load", s.damping_load, float{}, "", block);
    each("particles/half_kick", s.half_kick, float{}, "", block);
    each("particles/image", s.image, std::int32_t{}, "", block);
}

template <class State, class Each>
void contact_columns(State& s, Each&& each) {
    const Spread table = Spread::table, whole = Spread::whole;
    each("contacts/pair", s.contact_pair, std::uint64_t{}, "", table);
    each("contacts/image", s.contact_image, std::int8_t{}, "", table);
    each("contacts/tangential_displacement", s.contact_displacement, double{}, "m", table);
    each("contacts/normal_overlap_offset", s.contact_offset, double{}, "m", table);
    each("contacts/state", s.contact_state, std::uint8_t{}, "", table);
    each("walls/pair", s.wall_pair, std::uint64_t{}, "", table);
    each("walls/tangential_displacement", s.wall_displacement, double{}, "m", table);
    each("walls/normal_overlap_offset", s.wall_offset, double{}, "m", table);
    each("walls/state", s.wall_state, std::uint8_t{}, "", table);
    each("walls/sums", s.wall_sums, std::int64_t{}, "", whole);
    each("walls/peaks", s.wall_peaks, double{}, "", whole);
    each("sleep/asleep", s.asleep, std::uint8_t{}, "", whole);
    each("sleep/reference", s.sleep_reference, float{}, "N", whole);
    each("sleep/balance", s.sleep_balance, std::int64_t{}, "", whole);
    each("sleep/quiet", s.sleep_quiet, std::uint8_t{}, "", whole);
    each("sleep/scalars", s.sleep_scalars, double{}, "", whole);
    each("sleep/audited", s.sleep_audited, double{}, "", whole);
    each("ledger/sums", s.ledger, std::int64_t{}, "", whole);
    each("ledger/scalars", s.scalars, double{}, "", whole);
}

template <class State, class Each>
void grain_columns(State& g, Each&& each) {
    each("start/position", g.position, double{}, "m", Spread::block);
    each("start/radius", g.radius, double{}, "m", Spread::block);
    each("start/mass", g.mass, double{}, "kg", Spread::block);
    each("start/species", g.species, std::uint8_t{}, "", Spread::block);
    each("start/release", g.release, std::uint8_t{}, "", Spread::block);
    each("start/material", g.material, std::uint8_t{}, "", Spread::block);
}

std::int64_t integer(const io::Attributes& attributes, const std::string& name) {
    const auto it = attributes.find(name);
    const auto* value = it == attributes.end() ? nullptr : std::get_if<std::int64_t>(&it->second);
    if (value == nullptr)
        throw Error(ExitCode::input_invalid, "checkpoint: attribute " + name + " is missing");
    return *value;
}

} // namespace

io::CheckpointFile pack(const Grains& grains, const engine::Simulation& simulation,
                        const engine::RunPosition& position, const parallel::Communicator& world) {
    io::CheckpointFile file;
    const auto rows = [&world](const auto& values, Spread spread) {
        return spread == Spread::whole ? io::Rows{} : rows_of(values.size(), world);
    };
    grain_columns(grains, [&](const std::string& name, const auto& values, auto scalar,
                              const std::string& unit, Spread spread) {
        file.columns.push_back(as_column<decltype(scalar)>(name, values, unit, rows(values, spread)));
    });
    // The state is of the size of all that the engine keeps: a half of it at a time, and of that what is not
    // yet a column.
    const auto half_later = [&](auto save, auto for_columns) {
        file.later.emplace_back([rows, save, for_columns] {
            engine::SavedState state;
            save(state);
            std::vector<io::Column> columns;
            for_columns(state, [&](const std::string& name, auto& values, auto scalar,
                                   const std::string& unit, Spread spread) {
                columns.push_back(as_column<decltype(scalar)>(name, values, unit, rows(values, spread)));
                values = {};
                values.shrink_to_fit();
            });
            return columns;
        });
    };
    half_later([&simulation](auto& state) { simulation.save_particles(state); },
               [](auto& state, auto each) { particle_columns(state, each); });
    half_later([&simulation](auto& state) { simulation.save_contacts(state); },
               [](auto& state, auto each) { contact_columns(state, each); });
    const Box box = grains.box.value_or(Box{});
    file.columns.push_back(
        as_column<double>("start/box", std::vector<Vec3>{box.lower, box.upper, grains.origin}, "m"));
    file.columns.push_back(
        {"start/periodic",
         std::vector<std::uint8_t>{grains.box.has_value(), box.periodic[0], box.periodic[1], box.periodic[2]},
         1,
         "",
         {}});
    file.attributes = {{"step", simulation.steps()},
                       {"time", simulation.time()},
                       {"time_step", simulation.time_step().step},
                       {"stage", static_cast<std::int64_t>(position.stage)},
                       {"stage_start", position.stage_start},
                       {"coordinate_system", grains.coordinate_system}};
    return file;
}

std::uint64_t particle_count(const io::CheckpointReader& file) {
    return file.rows("particles/position");
}

Grains unpack_grains(const io::CheckpointReader& file, std::uint64_t first, std::uint64_t count) {
    Grains grains;
    grain_columns(grains, [&](const std::string& name, auto& values, auto scalar, const char*, Spread) {
        read_rows<decltype(scalar)>(file, name, first, count, values);
    });
    std::vector<Vec3> corners;
    std::vector<std::uint8_t> periodic;
    from_column<double>(file.read("start/box"), corners);
    from_column<std::uint8_t>(file.read("start/periodic"), periodic);
    if (corners.size() != 3 || periodic.size() != 4)
        throw Error(ExitCode::input_invalid, "checkpoint: its box has the wrong size");
    grains.origin = corners[2];
    if (periodic[0])
        grains.box = Box{corners[0], corners[1], {periodic[1] != 0, periodic[2] != 0, periodic[3] != 0}};
    const io::Attributes attributes = file.attributes();
    if (const auto it = attributes.find("coordinate_system"); it != attributes.end())
        grains.coordinate_system = std::get<std::string>(it->second);
    return grains;
}

void check_same_run(const io::CheckpointReader& file, const std::string& path, const Grains& grains,
                    std::uint64_t first, const std::string& config) {
    const auto other_model = [&] {
        throw Error(ExitCode::input_invalid,
                    path +
                        ": the checkpoint belongs to another model; remove it, or resume with its own model");
    };
    if (first + grains.size() > particle_count(file))
        other_model();
    const Grains before = unpack_grains(file, first, grains.size());
    if (before.position != grains.position || before.radius != grains.radius ||
        before.species != grains.species || before.material != grains.material)
        other_model();
    const auto physics = [](const std::string& text) {
        nlohmann::json json = nlohmann::json::parse(text.empty() ? "{}" : text);
        for (const char* key : {"output", "stages", "skin", "kernel", "seed"})
            json.erase(key);
        if (json.contains("time"))
            json["time"].erase("end");
        return json;
    };
    const nlohmann::json changes = nlohmann::json::diff(physics(file.config()), physics(config));
    if (!changes.empty())
        throw Error(ExitCode::configuration_invalid,
                    path + ": the checkpoint was made with another " + changes[0]["path"].get<std::string>() +
                        "; remove it, or resume with the settings it was made with");
}

engine::SavedState unpack_state(const io::CheckpointReader& file, std::uint64_t first, std::uint64_t count,
                                const parallel::Communicator& world) {
    engine::SavedState state;
    const auto rank = static_cast<std::uint64_t>(world.rank()),
               ranks = static_cast<std::uint64_t>(world.size());
    const auto read = [&](const std::string& name, auto& values, auto scalar, const char*, Spread spread) {
        const std::uint64_t rows = file.rows(name), begin = rows * rank / ranks;
        if (spread == Spread::block)
            read_rows<decltype(scalar)>(file, name, first, count, values);
        else if (spread == Spread::table)
            read_rows<decltype(scalar)>(file, name, begin, rows * (rank + 1) / ranks - begin, values);
        else
            from_column<decltype(scalar)>(file.read(name), values);
    };
    particle_columns(state, read);
    contact_columns(state, read);
    state.step = step_of(file);
    return state;
}

std::int64_t step_of(const io::CheckpointReader& file) {
    return integer(file.attributes(), "step");
}

engine::RunPosition unpack_position(const io::CheckpointReader& file) {
    const io::Attributes attributes = file.attributes();
    return {static_cast<std::size_t>(integer(attributes, "stage")), integer(attributes, "stage_start")};
}

} // namespace talus::dem_run
