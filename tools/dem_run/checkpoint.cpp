// SPDX-License-Identifier: GPL-3.0-or-later
#include "dem_run/checkpoint.hpp"

#include "base/error.hpp"

#include <array>
#include <cstring>
#include <nlohmann/json.hpp>

namespace talus::dem_run {

namespace {

/// Arrays of small fixed-size values as one flat column, and back.
template <class Scalar, class Value>
io::Column flat(const std::string& name, const std::vector<Value>& values, const std::string& unit = "") {
    static_assert(sizeof(Value) % sizeof(Scalar) == 0 && std::is_trivially_copyable_v<Value>);
    constexpr std::size_t width = sizeof(Value) / sizeof(Scalar);
    std::vector<Scalar> data(values.size() * width);
    if (!values.empty())
        std::memcpy(data.data(), values.data(), values.size() * sizeof(Value));
    return {name, std::move(data), width, unit};
}

template <class Scalar, class Value>
void restore(const io::CheckpointFile& file, const std::string& name, std::vector<Value>& values) {
    const std::vector<Scalar>& data = file.get<Scalar>(name);
    constexpr std::size_t width = sizeof(Value) / sizeof(Scalar);
    if (data.size() % width != 0)
        throw Error(ExitCode::input_invalid, "checkpoint: column " + name + " has the wrong width");
    values.resize(data.size() / width);
    if (!data.empty())
        std::memcpy(static_cast<void*>(values.data()), data.data(), data.size() * sizeof(Scalar));
}

/// One list of all columns, used both ways: `each(name, values, scalar, unit)`.
template <class State, class Each>
void state_columns(State& s, Each&& each) {
    each("particles/position", s.position, double{}, "m");
    each("particles/half_velocity", s.half_velocity, double{}, "m s-1");
    each("particles/half_angular_velocity", s.half_angular_velocity, double{}, "rad s-1");
    each("particles/acceleration", s.acceleration, double{}, "m s-2");
    each("particles/angular_acceleration", s.angular_acceleration, double{}, "rad s-2");
    each("particles/damping_load", s.damping_load, float{}, "");
    each("particles/half_kick", s.half_kick, float{}, "");
    each("particles/image", s.image, std::int32_t{}, "");
    each("contacts/pair", s.contact_pair, std::uint64_t{}, "");
    each("contacts/image", s.contact_image, std::int8_t{}, "");
    each("contacts/tangential_displacement", s.contact_displacement, double{}, "m");
    each("contacts/normal_overlap_offset", s.contact_offset, double{}, "m");
    each("contacts/state", s.contact_state, std::uint8_t{}, "");
    each("walls/pair", s.wall_pair, std::uint64_t{}, "");
    each("walls/tangential_displacement", s.wall_displacement, double{}, "m");
    each("walls/normal_overlap_offset", s.wall_offset, double{}, "m");
    each("walls/state", s.wall_state, std::uint8_t{}, "");
    each("ledger/sums", s.ledger, std::int64_t{}, "");
    each("ledger/scalars", s.scalars, double{}, "");
}

template <class State, class Each>
void grain_columns(State& g, Each&& each) {
    each("start/position", g.position, double{}, "m");
    each("start/radius", g.radius, double{}, "m");
    each("start/mass", g.mass, double{}, "kg");
    each("start/species", g.species, std::uint8_t{}, "");
    each("start/release", g.release, std::uint8_t{}, "");
    each("start/material", g.material, std::uint8_t{}, "");
}

std::int64_t integer(const io::CheckpointFile& file, const std::string& name) {
    const auto it = file.attributes.find(name);
    const auto* value = it == file.attributes.end() ? nullptr : std::get_if<std::int64_t>(&it->second);
    if (value == nullptr)
        throw Error(ExitCode::input_invalid, "checkpoint: attribute " + name + " is missing");
    return *value;
}

} // namespace

io::CheckpointFile pack(const Grains& grains, const engine::Simulation& simulation,
                        const engine::RunPosition& position) {
    io::CheckpointFile file;
    const engine::SavedState state = simulation.save();
    const auto add = [&](const std::string& name, const auto& values, auto scalar, const std::string& unit) {
        file.columns.push_back(flat<decltype(scalar)>(name, values, unit));
    };
    state_columns(state, add);
    grain_columns(grains, add);
    const Box box = grains.box.value_or(Box{});
    file.columns.push_back(
        flat<double>("start/box", std::vector<Vec3>{box.lower, box.upper, grains.origin}, "m"));
    file.columns.push_back(
        {"start/periodic",
         std::vector<std::uint8_t>{grains.box.has_value(), box.periodic[0], box.periodic[1], box.periodic[2]},
         1, ""});
    file.attributes = {{"step", state.step},
                       {"time", simulation.time()},
                       {"time_step", simulation.time_step().step},
                       {"stage", static_cast<std::int64_t>(position.stage)},
                       {"stage_start", position.stage_start},
                       {"coordinate_system", grains.coordinate_system}};
    return file;
}

Grains unpack_grains(const io::CheckpointFile& file) {
    Grains grains;
    grain_columns(grains, [&](const std::string& name, auto& values, auto scalar, const char*) {
        restore<decltype(scalar)>(file, name, values);
    });
    std::vector<Vec3> corners;
    restore<double>(file, "start/box", corners);
    const auto& periodic = file.get<std::uint8_t>("start/periodic");
    if (corners.size() != 3 || periodic.size() != 4)
        throw Error(ExitCode::input_invalid, "checkpoint: its box has the wrong size");
    grains.origin = corners[2];
    if (periodic[0])
        grains.box = Box{corners[0], corners[1], {periodic[1] != 0, periodic[2] != 0, periodic[3] != 0}};
    if (const auto it = file.attributes.find("coordinate_system"); it != file.attributes.end())
        grains.coordinate_system = std::get<std::string>(it->second);
    return grains;
}

void check_same_run(const io::CheckpointFile& file, const std::string& path, const Grains& grains,
                    const std::string& config) {
    const Grains before = unpack_grains(file);
    if (before.position != grains.position || before.radius != grains.radius ||
        before.species != grains.species || before.material != grains.material)
        throw Error(ExitCode::input_invalid,
                    path +
                        ": the checkpoint belongs to another model; remove it, or resume with its own model");
    const auto physics = [](const std::string& text) {
        nlohmann::json json = nlohmann::json::parse(text.empty() ? "{}" : text);
        for (const char* key : {"output", "stages", "skin", "kernel", "seed"})
            json.erase(key);
        if (json.contains("time"))
            json["time"].erase("end");
        return json;
    };
    const nlohmann::json changes = nlohmann::json::diff(physics(file.config), physics(config));
    if (!changes.empty())
        throw Error(ExitCode::configuration_invalid,
                    path + ": the checkpoint was made with another " + changes[0]["path"].get<std::string>() +
                        "; remove it, or resume with the settings it was made with");
}

engine::SavedState unpack_state(const io::CheckpointFile& file) {
    engine::SavedState state;
    state_columns(state, [&](const std::string& name, auto& values, auto scalar, const char*) {
        restore<decltype(scalar)>(file, name, values);
    });
    state.step = integer(file, "step");
    return state;
}

engine::RunPosition unpack_position(const io::CheckpointFile& file) {
    return {static_cast<std::size_t>(integer(file, "stage")), integer(file, "stage_start")};
}

} // namespace talus::dem_run
