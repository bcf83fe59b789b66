// SPDX-License-Identifier: GPL-3.0-or-later
#include "dem_run/recorder.hpp"

#include "base/error.hpp"
#include "cli/signals.hpp"

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>
#include <limits>

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
                   StopRules rules, cli::Progress& progress, bool first_rank,
                   std::function<void()> checkpoint)
    : writer_(writer), scene_(scene), position_(position), fields_(std::move(fields)), shift_(shift),
      rules_(std::move(rules)), progress_(progress), first_rank_(first_rank),
      checkpoint_(std::move(checkpoint)) {
    std::sort(fields_.begin(), fields_.end());
}

void Recorder::stage(const engine::Stage& stage, const engine::Simulation& s, std::size_t released) {
    released_ += released;
    writer_.stage({stage.name, s.steps(), s.time()});
}

void Recorder::frame(const engine::Simulation& s) {
    engine::Snapshot now = s.snapshot();
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
    writer_.frame(s.steps(), s.time(), fields);
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
    if (scene_.triaxial) {
        if (const auto grain = s.outside_membrane())
            throw Error(
                ExitCode::run_failed,
                fmt::format("particle {}: stands outside the membrane at t = {:.6g} s: give it smaller "
                            "particles (triaxial.membrane_radius) or a larger modulus",
                            *grain, s.time()));
        const engine::TriaxialMeasures m = s.triaxial_measures();
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
    if (asked & signal_came)
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
    if (!first_rank_ || now - last_look_ <= 0.2) // the clock and the disk are looked at five times a second
        return;
    last_look_ = now;
    show(s);
    if (rules_.max_wall && now >= *rules_.max_wall)
        s.ask(wall_time_is_up);
    if (std::filesystem::exists(rules_.stop_file))
        s.ask(stop_file_is_there);
    if (now - last_checkpoint_ >= rules_.checkpoint_interval) {
        last_checkpoint_ = now;
        s.ask(checkpoint_is_due);
    }
}

} // namespace talus::dem_run
