// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/run_output.hpp"

#include "base/error.hpp"

#include <fmt/format.h>

namespace talus::measure {

namespace {

void check_count(std::size_t before, std::size_t now) {
    if (before != now)
        throw Error(
            ExitCode::run_failed,
            fmt::format("output: positions of {} particles after those of {}; this is a mistake of the "
                        "program",
                        now, before));
}

} // namespace

void ChangedParticles::write_all(std::span<const Vec3> position) {
    state_.written.assign(position.begin(), position.end());
    state_.last.assign(position.size(), 0);
}

std::vector<std::uint64_t> ChangedParticles::write_changes(std::span<const Vec3> position) {
    check_count(state_.written.size(), position.size());
    std::vector<std::uint64_t> rows;
    for (std::size_t i = 0; i < position.size(); ++i) {
        const bool moved = norm2(position[i] - state_.written[i]) > tolerance2_;
        if (moved || state_.last[i]) {
            rows.push_back(i);
            state_.written[i] = position[i];
        }
        state_.last[i] = moved;
    }
    return rows;
}

void WayLength::start(std::span<const Vec3> position) {
    state_.position.assign(position.begin(), position.end());
    state_.distance.assign(position.size(), 0);
}

void WayLength::add(std::span<const Vec3> position) {
    check_count(state_.position.size(), position.size());
    for (std::size_t i = 0; i < position.size(); ++i) {
        state_.distance[i] += norm(position[i] - state_.position[i]);
        state_.position[i] = position[i];
    }
}

} // namespace talus::measure
