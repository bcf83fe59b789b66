// SPDX-License-Identifier: GPL-3.0-or-later
/// What walls and monitored groups of fixed grains take.
#include "base/error.hpp"
#include "engine/simulation.hpp"

#include <fmt/format.h>

namespace talus::engine {

namespace {

Simulation::WallLoad load_from(const ExactSum* sums) {
    return {{sums[0].value(), sums[1].value(), sums[2].value()},
            {sums[3].value(), sums[4].value(), sums[5].value()}};
}

} // namespace

/// Takes in the walls' forces as just computed.
/// @throws Error for a particle that a mesh runs through
void Simulation::record_walls(bool first) {
    if (const auto pierced = walls_.pierced()) {
        const auto [row, wall] = *pierced;
        const std::string who = fmt::format("particle {}: its centre lies in the mesh of wall \"{}\"",
                                            particles_.id[row], walls_.wall(wall).name);
        if (first)
            throw Error(ExitCode::input_invalid,
                        who + ", expected it beside: cut the model where the wall is to stand");
        throw Error(
            ExitCode::run_failed,
            fmt::format("{} at step {} (t = {:.6g} s), pushed in by nearly its radius: take a smaller "
                        "time.step, or a stiffer material",
                        who, step_, time()));
    }
    wall_record_.add(walls_, particles_, images_.box(), step_, first, team_, world_);
}

std::vector<WallReport> Simulation::wall_reports() const {
    evaluated();
    WallRecord record = wall_record_;
    record.merge(world_);
    return record.report(walls_, particles_, images_.box(), time_step_.step, step_, world_);
}

std::vector<Simulation::WallLoad> Simulation::wall_loads() const {
    std::vector<ExactSum> sums = evaluated().walls_.totals(particles_, images_.box(), record_scale());
    world_.sum(sums);
    std::vector<WallLoad> loads(walls_.count());
    for (std::size_t w = 0; w < loads.size(); ++w)
        loads[w] = load_from(sums.data() + 6 * w);
    return loads;
}

/// Adds a pair's force on its first particle (N) to the monitors that either particle belongs to.
void Simulation::add_to_monitors(const search::Candidate& pair, const Vec3& force, Tally& tally) const {
    const ParticleColumns& p = particles_;
    const Record &xi = p.bodies[pair.i].position, &xj = p.bodies[pair.j].position;
    const Vec3 touch = xi.vec() + (xi.w / (xi.w + xj.w)) * (xj.vec() - xi.vec());
    tally.monitored.resize(6 * scene_.monitors.size(), ExactSum(record_scale()));
    for (const auto& [row, on_it] : {std::pair{pair.i, force}, std::pair{pair.j, -force}}) {
        if (p.species[p.owner(row)] != Species::fixed || (sleep_ && sleep_->asleep_row[p.owner(row)]))
            continue;
        const Vec3 x = p.bodies[row].position.vec(), home = images_.box().wrap(x);
        for (std::size_t m = 0; m < scene_.monitors.size(); ++m) {
            const Monitor& monitor = scene_.monitors[m];
            if (!monitor.holds(home))
                continue;
            const Vec3 torque = cross(touch - x + home - 0.5 * (monitor.lower + monitor.upper), on_it);
            for (int k = 0; k < 3; ++k) {
                tally.monitored[6 * m + static_cast<std::size_t>(k)].add(on_it[k]);
                tally.monitored[6 * m + 3 + static_cast<std::size_t>(k)].add(torque[k]);
            }
        }
    }
}

std::vector<Simulation::WallLoad> Simulation::monitor_loads() const {
    evaluated();
    std::vector<ExactSum> sums(6 * scene_.monitors.size(), ExactSum(record_scale()));
    for (const Tally& tally : tallies_)
        for (std::size_t k = 0; k < tally.monitored.size(); ++k)
            sums[k].add(tally.monitored[k]);
    world_.sum(sums);
    std::vector<WallLoad> loads;
    for (std::size_t m = 0; m < scene_.monitors.size(); ++m)
        loads.push_back(load_from(sums.data() + 6 * m));
    return loads;
}

/// @throws Error(configuration_invalid) for a monitor without a fixed grain
void Simulation::check_monitors() const {
    for (const Monitor& monitor : scene_.monitors) {
        std::uint64_t fixed = 0;
        for (std::size_t row = 0; row < particles_.owned; ++row)
            fixed += particles_.species[row] == Species::fixed &&
                     monitor.holds(images_.box().wrap(particles_.bodies[row].position.vec()));
        if (world_.sum(fixed) == 0)
            throw Error(ExitCode::configuration_invalid,
                        fmt::format("monitors: found no fixed grain in the box of \"{}\", expected one at "
                                    "least; its corners are in the model's coordinates",
                                    monitor.name));
    }
}

} // namespace talus::engine
