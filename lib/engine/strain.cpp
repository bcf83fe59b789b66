// SPDX-License-Identifier: GPL-3.0-or-later
/// Stretching the periodic cell.
#include "base/error.hpp"
#include "engine/simulation.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>

namespace talus::engine {

namespace {

Vec3 times(const Vec3& a, const Vec3& b) {
    return {a.x * b.x, a.y * b.y, a.z * b.z};
}

} // namespace

void Simulation::step_and_strain(const Vec3& factor) {
    check_strain(factor);
    advance_time(&factor);
    keep_lists_valid();
    if (kernel_.traits.tangential && (factor.x != factor.y || factor.y != factor.z))
        strain_contacts(factor);
}

void Simulation::check_strain(const Vec3& factor) const {
    const auto refuse = [](const std::string& what) {
        throw Error(ExitCode::configuration_invalid, "strain: " + what);
    };
    if (!world_.alone())
        refuse(fmt::format("found {} ranks, but a cell is strained on one only: use threads", world_.size()));
    if (walls_.any())
        refuse("found walls, which would not go along: use a box that is periodic instead of them");
    if (mobile_ != size())
        refuse(
            fmt::format("found {} fixed grains, which would not go along: let them move", size() - mobile_));
    const Box& box = images_.box();
    for (int k = 0; k < 3; ++k) {
        const double f = factor[k];
        if (!(f > 0) || !std::isfinite(f))
            refuse(fmt::format("found a factor of {}, expected a number above 0", f));
        if (f == 1)
            continue;
        if (!box.periodic[static_cast<std::size_t>(k)])
            refuse(fmt::format("found a factor of {} along {}, where the box is not periodic: use 1", f,
                               "xyz"[k]));
        const double edge = f * box.lengths()[k], reach = 2 * half_reach() + scene_.skin * largest_radius_;
        if (edge < reach)
            refuse(fmt::format("a periodic edge of {} m is shorter than the reach {} m of the largest "
                               "grains (2 r and the skin): strain less",
                               edge, reach));
    }
}

/// Box and positions. A particle is moved with the image of it that is inside the box, so that it does not
/// matter whether it has been wrapped yet.
void Simulation::strain_cell(const Vec3& factor) {
    const Box before = images_.box();
    Box after = before;
    for (int k = 0; k < 3; ++k)
        if (factor[k] != 1)
            after.upper[k] = before.lower[k] + factor[k] * (before.upper[k] - before.lower[k]);
    images_ = parallel::PeriodicImages(after);
    const Vec3 lower = images_.box().lower, old_edge = before.lengths(), edge = images_.box().lengths();
    team_.for_range(particles_.owned, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row) {
            Record& position = particles_.bodies[row].position;
            Vec3 x = position.vec();
            for (int k = 0; k < 3; ++k) {
                if (!before.periodic[static_cast<std::size_t>(k)])
                    continue;
                const double from = x[k] - before.lower[k], lengths = std::floor(from / old_edge[k]);
                x[k] = lower[k] + factor[k] * (from - lengths * old_edge[k]);
                x[k] = images_.snap(x)[k] + lengths * edge[k];
            }
            position.set(x);
        }
    });
    // What the lists' skins lose by it.
    const double lost = shortened(strain_since_refresh_);
    strain_since_rebuild_ = times(strain_since_rebuild_, factor);
    strain_since_refresh_ = times(strain_since_refresh_, factor);
    used_ += std::max(0.0, shortened(strain_since_refresh_) - lost) * half_reach() / least_share_;
    if (!straining_ && !motion_.still()) {
        motion_holds_for_ = -1; // lists that do not follow the motion, from now on
    }
    straining_ = true;
}

/// Turns the tangential displacements with their contacts' normals and adds what the stretch sheared them by.
void Simulation::strain_contacts(const Vec3& factor) {
    const ParticleColumns& p = particles_;
    team_.for_range(list_.size(), [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k) {
            if (!(pairs_.state[k] & contact::contact_active))
                continue;
            const search::Candidate c = list_.candidates()[k];
            const Vec3 branch = p.bodies[c.j].position.vec() - p.bodies[c.i].position.vec();
            const Vec3 before{branch.x / factor.x, branch.y / factor.y, branch.z / factor.z};
            const Vec3 normal = branch / norm(branch), old_normal = before / norm(before);
            const Vec3 half = (normal + old_normal) / (1 + dot(normal, old_normal));
            const Vec3 moved = before - branch; // of i against j
            const Vec3 sheared = moved - dot(moved, half) * half / dot(half, half);
            contact::History history = pairs_.load(k);
            history.tangential_displacement =
                contact::carry_along(history.tangential_displacement, normal, half, 0) + sheared -
                dot(sheared, normal) * normal;
            pairs_.store(k, history);
        }
    });
}

} // namespace talus::engine
