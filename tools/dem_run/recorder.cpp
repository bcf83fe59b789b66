// SPDX-License-Identifier: GPL-3.0-or-later
#include "dem_run/recorder.hpp"

#include "base/error.hpp"
#include "cli/signals.hpp"
#include "dem_run/columns.hpp"

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>
#include <limits>
#include <utility>

namespace talus::dem_run {

namespace {

/// What the ranks tell each other through Simulation::ask.
enum : unsigned { signal_came = 1, wall_time_is_up = 2, stop_file_is_there = 4, checkpoint_is_due = 8 };

} // namespace

Vec3 output_shift(const Grains& grains, const parallel::Communicator& world) {
    constexpr double inf = std::numeric_limits<double>::infinity();
    Vec3 lower{inf, inf, inf};
    double largest = 0, smallest_radius = inf;
    for (std::size_t k = 0; k < grains.size(); ++k) {
        smallest_radius = std::min(smallest_radius, grains.radius[k]);
        for (int d = 0; d < 3; ++d) {
            lower[d] = std::min(lower[d], grains.position[k][d]);
            largest = std::max(largest, std::abs(grains.position[k][d]));
        }
    }
    for (int d = 0; d < 3; ++d)
        lower[d] = world.min(lower[d]);
    largest = world.max(largest);
    smallest_radius = world.min(smallest_radius);
    if (largest * std::numeric_limits<float>::epsilon() <= 1e-3 * smallest_radius)
        return {};
    return {std::floor(lower.x), std::floor(lower.y), std::floor(lower.z)};
}

Recorder::Recorder(io::TrajectoryWriter& writer, const engine::Scene& scene,
                   const engine::RunPosition& position, std::vector<std::string> fields, const Vec3& shift,
                   StopRules rules, OutputRules output, cli::Progress& progress,
                   const parallel::Communicator& world, std::function<void()> checkpoint)
    : writer_(writer), scene_(scene), position_(position), fields_(std::move(fields)), shift_(shift),
      rules_(std::move(rules)), output_(output), travel_(scene.travel_intervals.size()), progress_(progress),
      world_(world), first_rank_(world.rank() == 0), checkpoint_(std::move(checkpoint)) {
    if (output_.change_tolerance)
        changed_.emplace(*output_.change_tolerance);
    std::sort(fields_.begin(), fields_.end());
}

void Recorder::stage(const engine::Stage& stage, const engine::Simulation& s, std::size_t released) {
    released_ += released;
    writer_.stage({stage.name, s.steps(), s.time()});
    full_ = true;
}

void Recorder::frame(const engine::Simulation& s) {
    engine::Snapshot now = s.snapshot();
    std::vector<std::uint64_t> particles;
    const bool full = std::exchange(full_, false) || !changed_;
    if (changed_ && full)
        changed_->write_all(now.position);
    else if (changed_)
        particles = changed_->write_changes(now.position);
    for (Vec3& x : now.position)
        x -= shift_;
    std::vector<io::TrajectoryWriter::Field> fields;
    for (const std::string& name : fields_) {
        const std::vector<Vec3>& values = name == "position"           ? now.position
                                          : name == "velocity"         ? now.velocity
                                          : name == "angular_velocity" ? now.angular_velocity
                                                                       : now.force;
        fields.emplace_back(name, values);
    }
    if (full) {
        writer_.frame(s.steps(), s.time(), fields);
        return;
    }
    std::vector<std::vector<Vec3>> part(fields.size());
    for (std::size_t f = 0; f < fields.size(); ++f) {
        for (const std::uint64_t row : particles)
            part[f].push_back(fields[f].second[row]);
        fields[f].second = part[f];
    }
    for (std::uint64_t& row : particles)
        row += s.first_id();
    writer_.changes(s.steps(), s.time(), particles, fields, rows_of(particles.size(), world_));
}

void Recorder::positions(const engine::Simulation& s, unsigned kinds) {
    if (position_.stage < output_.travel_from)
        return;
    const std::vector<Vec3> now = s.positions();
    const bool begins = position_.stage == output_.travel_from && position_.stage_start == s.steps();
    if (begins)
        travel_start_ = s.steps();
    for (std::size_t k = 0; k < travel_.size(); ++k)
        if (begins)
            travel_[k].start(now);
        else if (kinds & (1u << k))
            travel_[k].add(now);
}

namespace {

const std::string travel_names[] = {"travel_distance", "travel_distance_fine"};

template <class Scalar, class Value>
void read_column(const io::CheckpointReader& file, const std::string& name, std::uint64_t first,
                 std::uint64_t count, std::vector<Value>& values) {
    if (!file.has(name))
        throw Error(ExitCode::input_invalid,
                    "checkpoint: column " + name +
                        " is missing; resume with the output settings that the run began with");
    from_column<Scalar>(file.read(name, first, count), values);
}

} // namespace

void Recorder::save(io::CheckpointFile& file) const {
    if (changed_ && !changed_->state().written.empty()) {
        const auto& state = changed_->state();
        const io::Rows rows = rows_of(state.written.size(), world_);
        file.columns.push_back(as_column<double>("output/written_position", state.written, "m", rows));
        file.columns.push_back(as_column<std::uint8_t>("output/changed_last", state.last, "", rows));
    }
    for (std::size_t k = 0; k < travel_.size(); ++k) {
        if (!world_.any(travel_[k].started()))
            continue;
        const auto& state = travel_[k].state();
        const io::Rows rows = rows_of(state.distance.size(), world_);
        file.columns.push_back(as_column<double>("output/" + travel_names[k], state.distance, "m", rows));
        file.columns.push_back(
            as_column<double>("output/" + travel_names[k] + "_position", state.position, "m", rows));
    }
    file.attributes["travel_start"] = travel_start_;
}

void Recorder::restore(const io::CheckpointReader& file, bool goes_on, std::uint64_t first,
                       std::uint64_t count) {
    full_ = !goes_on;
    if (changed_ && goes_on) {
        measure::ChangedParticles::State state;
        read_column<double>(file, "output/written_position", first, count, state.written);
        read_column<std::uint8_t>(file, "output/changed_last", first, count, state.last);
        changed_->restore(std::move(state));
    }
    const io::Attributes attributes = file.attributes();
    if (const auto it = attributes.find("travel_start"); it != attributes.end())
        travel_start_ = std::get<std::int64_t>(it->second);
    for (std::size_t k = 0; k < travel_.size(); ++k) {
        if (position_.stage < output_.travel_from)
            continue;
        measure::WayLength::State state;
        read_column<double>(file, "output/" + travel_names[k], first, count, state.distance);
        read_column<double>(file, "output/" + travel_names[k] + "_position", first, count, state.position);
        travel_[k].restore(std::move(state));
    }
}

void Recorder::finish(const engine::Simulation& s) {
    for (std::size_t k = 0; k < travel_.size(); ++k)
        if (world_.any(travel_[k].started()))
            writer_.column(travel_names[k], "m", travel_[k].state().distance,
                           {{"interval", scene_.travel_intervals[k]},
                            {"from_step", static_cast<double>(travel_start_)},
                            {"from_time", static_cast<double>(travel_start_) * s.time_step().step}});
}

void Recorder::series(const engine::Simulation& s) {
    const engine::Energies e = s.energies();
    const engine::RestState rest = s.rest_state();
    std::vector<std::pair<std::string, double>> row{
        {"step", static_cast<double>(s.steps())},
        {"time", s.time()},
        {"stage", static_cast<double>(position_.stage)},
        {"kinetic_energy", e.kinetic},
        {"potential_energy", e.potential},
        {"elastic_energy", e.elastic},
        {"dissipated_energy", e.tangential + e.damping + e.fracture},
        {"supplied_energy", e.supplied},
        {"total_energy", e.total()},
        {"energy_error", s.energy_error()},
        {"unbalanced_force", rest.unbalanced_force},
        {"coordination_number", rest.coordination_number},
        {"max_speed", rest.max_speed},
        {"rms_speed", rest.rms_speed},
        {"contact_count", static_cast<double>(s.contacts())},
        {"bond_count", static_cast<double>(s.bonds())}};
    const std::vector<engine::Simulation::WallLoad> loads = s.wall_loads();
    for (std::size_t w = 0; w < loads.size(); ++w)
        for (int k = 0; k < 3; ++k) {
            const std::string prefix = "walls/" + scene_.walls[w].name + "/";
            row.emplace_back(prefix + "force_" + "xyz"[k], loads[w].force[k]);
            row.emplace_back(prefix + "torque_" + "xyz"[k], loads[w].torque[k]);
        }
    const std::vector<engine::Simulation::WallLoad> monitors = s.monitor_loads();
    for (std::size_t m = 0; m < monitors.size(); ++m)
        for (int k = 0; k < 3; ++k) {
            const std::string prefix = "monitors/" + scene_.monitors[m].name + "/";
            row.emplace_back(prefix + "force_" + "xyz"[k], monitors[m].force[k]);
            row.emplace_back(prefix + "torque_" + "xyz"[k], monitors[m].torque[k]);
        }
    if (scene_.shaking) {
        const engine::GroundMotion ground = s.ground_motion();
        for (int k = 0; k < 3; ++k) {
            row.emplace_back(std::string("ground/acceleration_") + "xyz"[k], ground.acceleration[k]);
            row.emplace_back(std::string("ground/velocity_") + "xyz"[k], ground.velocity[k]);
            row.emplace_back(std::string("ground/displacement_") + "xyz"[k], ground.displacement[k]);
        }
    }
    if (!scene_.strength_reductions.empty()) {
        const std::vector<double> factors = s.strength_factors();
        for (std::size_t k = 0; k < factors.size(); ++k)
            row.emplace_back(fmt::format("strength_reduction/{}/factor", k), factors[k]);
    }
    if (scene_.triaxial) {
        const engine::TriaxialMeasures m = s.triaxial_measures();
        if (const auto grain = s.outside_membrane())
            failure_ = fmt::format(
                "particle {}: stands outside the membrane at t = {:.6g} s, axial strain {:.4f} of "
                "{:g}: give the membrane smaller particles (triaxial.membrane_radius) or a larger "
                "modulus, or the platens friction",
                *grain, s.time(), m.axial_strain, scene_.triaxial->axial_strain);
        const auto add = [&](const char* name, double value) {
            row.emplace_back(std::string("triaxial/") + name, value);
        };
        add("axial_strain", m.axial_strain);
        add("volumetric_strain", m.volumetric_strain);
        add("axial_stress", m.axial_stress);
        add("axial_stress_top", m.axial_stress_top);
        add("axial_stress_bottom", m.axial_stress_bottom);
        add("confining_stress", m.confining_stress);
        add("confining_stress_target", m.confining_stress_target);
        add("deviatoric_stress", m.deviatoric_stress());
        add("height", m.height);
        add("area", m.area);
    }
    std::sort(row.begin(), row.end()); // as a reader lists them, so that a resumed file is like a whole one
    writer_.series(row);
}

void Recorder::bonds_broken(std::span<const engine::BondBreak> breaks, const engine::Simulation& s) {
    constexpr std::uint8_t mode_in_file[] = {2, 0, 1}; // released, tension, shear
    std::vector<io::BondBreakage> rows;
    rows.reserve(breaks.size());
    for (const engine::BondBreak& b : breaks) {
        rows.push_back({b.step, static_cast<double>(b.step) * s.time_step().step,
                        static_cast<std::int64_t>(b.i), static_cast<std::int64_t>(b.j), b.position - shift_,
                        mode_in_file[b.mode]});
        broken_ += b.mode != 0;
    }
    writer_.bond_breakages(rows);
}

double Recorder::elapsed() const {
    return std::chrono::duration<double>(Clock::now() - start_).count();
}

void Recorder::show(const engine::Simulation& s) {
    const engine::Stage& stage = scene_.stages[position_.stage];
    const double since = s.time() - static_cast<double>(position_.stage_start) * s.time_step().step;
    const double last = stage.until_rest ? stage.limit : stage.end;
    const double in_stage = last > 0 ? std::min(1.0, since / last) : 1.0;
    progress_.update((static_cast<double>(position_.stage) + in_stage) /
                         static_cast<double>(scene_.stages.size()),
                     fmt::format("{} t = {:.3g} s", stage.name, s.time()));
}

bool Recorder::stop(engine::Simulation& s) {
    look_around(s);
    const unsigned asked = s.asked();
    if (!failure_.empty())
        reason_ = failure_;
    else if (asked & signal_came)
        reason_ = "a signal";
    else if (asked & wall_time_is_up)
        reason_ = "--max-wall";
    else if (asked & stop_file_is_there)
        reason_ = "the file " + rules_.stop_file;
    else if (asked & checkpoint_is_due)
        checkpoint_();
    return !reason_.empty();
}

/// Asks for what is due; all ranks do it after the next step.
void Recorder::look_around(engine::Simulation& s) {
    if (cli::stop_requested())
        s.ask(signal_came);
    const double now = elapsed();
    if (first_rank_ && rules_.max_wall && now >= *rules_.max_wall)
        s.ask(wall_time_is_up);
    if (!first_rank_ || now - last_look_ <= 0.2) // the disk is looked at five times a second
        return;
    last_look_ = now;
    show(s);
    if (std::filesystem::exists(rules_.stop_file))
        s.ask(stop_file_is_there);
    if (now - last_checkpoint_ >= rules_.checkpoint_interval) {
        last_checkpoint_ = now;
        s.ask(checkpoint_is_due);
    }
}

} // namespace talus::dem_run
