// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "packing/grain_sizes.hpp"
#include "particles/grains.hpp"
#include "particles/material.hpp"

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace talus::packing {

/// The compress route: a fully periodic cell of frictionless Hertz spheres, jammed at a given solid fraction.
///
/// Grains are dropped at random, overlaps and all, at the target fraction plus `overcompression`, and relaxed
/// until the net forces are `quench_unbalanced_force` of the contact forces. The cell is then let out to the
/// target fraction and relaxed to balance. At a fixed fraction the coordination number is set by where the
/// packing jams (Z - Z_c grows as the square root of the distance to it: O'Hern et al. 2003), and a packing
/// jams the denser the further it was compressed before (Kumar & Luding 2016). So `overcompression` is what
/// steers Z: a box that comes out too loosely jammed (Z too large) is compressed and let out again, one that
/// does not jam at the target (or barely: Z too small) starts again from new random places with less
/// overcompression.
struct CompressSettings {
    GrainSizes sizes;
    Material material;
    std::optional<double> coordination_number;    ///< aim; empty: see aimed_coordination_number
    std::optional<double> coordination_tolerance; ///< empty: the larger of 0.1 and 3.6 / sqrt(N)
    std::optional<double> overcompression; ///< solid fraction above the target; empty: by number of grains
    double quench_unbalanced_force = 1e-2;
    /// In balance below: mean net force of grains in contact / mean contact force. Empty: see
    /// frictionless_unbalanced_force(). A box left at 5e-4 moves by more than its
    /// mean overlap when it is let go (pgbox-stats --run-on), one at 1e-4 by a quarter of it. A start that is
    /// not there after 60,000 force evaluations is taken below 9e-4 where the limit is empty, else given up.
    std::optional<double> unbalanced_force;
    std::int64_t attempts = 12;       ///< starts and recompressions together
    std::int64_t iterations = 400000; ///< force evaluations at most, all attempts together
    std::uint64_t seed = 1;
};

/// Coordination number of the published frictionless boxes (Chen, Furuichi & Nishiura, Table 2: 6.086 / 6.116
/// / 6.271 / 6.322 / 6.419 for 1,222,346 / 152,799 / 5,660 / 708 / 210 equal grains at 0.640), linear in log
/// N between. Only boxes of equal grains within 0.0015 of that fraction are held to it by default.
double aimed_coordination_number(std::int64_t particles);

/// Measures at one moment.
struct CompressState {
    std::int64_t iteration = 0, attempt = 0;
    double solid_volume_fraction = 0, coordination_number = 0;
    double mean_overlap_ratio = 0; ///< over the mean radius
    double pressure = 0;           ///< Pa
    double unbalanced_force = 0;   ///< as CompressSettings::unbalanced_force
};

struct CompressResult {
    PgBox box;
    bool converged = false;
    std::string failure; ///< which measure fell short and by how much; empty where converged
    CompressState end;
    std::vector<CompressState> history;
    double radius_factor = 1; ///< by which the radii asked for were multiplied to meet the fraction
    double overcompression = 0;
    std::int64_t attempts = 0;
};

/// Called some hundred times; `fraction` of the work is an estimate. May throw to stop.
using CompressObserver = std::function<void(const CompressState& state, double fraction)>;

/// Same settings, same bits, at any size of the team.
/// @throws Error(configuration_invalid) for settings that cannot be met
CompressResult compress(const CompressSettings& settings, ThreadTeam& team,
                        const CompressObserver& observer = {});

struct CompressForecast {
    std::int64_t particles = 0;
    double memory = 0;    ///< bytes
    double file_size = 0; ///< bytes
    double seconds = 0;   ///< on the given number of threads
};
CompressForecast forecast(const CompressSettings& settings, int threads);

} // namespace talus::packing
