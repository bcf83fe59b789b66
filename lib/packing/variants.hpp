// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "particles/grains.hpp"
#include "particles/material.hpp"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace talus::packing {

/// Variants of a PG box have the same grains at the faces, its skin, and other interiors. They fit together
/// in any order, so that a tiling can draw among them and does not repeat itself.

/// Skin thickness in largest radii where none is given. Contacts across a face need 2; what is more keeps
/// interior grains from getting near a face while they are packed anew.
inline constexpr double default_skin_radii = 2.25;

/// 1 for grains whose centres lie within `thickness` (m) of a face.
std::vector<std::uint8_t> skin_rows(const PgBox& box, double thickness);
/// Part of the box's volume within `thickness` of a face.
double skin_volume_fraction(double length, double thickness);
/// A hash of the first box's skin, its bits and rows, of the box's length and its number of grains: 16
/// hexadecimal digits, which variants of that box carry as their family's name.
std::string skin_hash(const PgBox& box, double thickness);

/// How an interior is packed; contacts with the skin included, which count half in the stress.
struct InteriorMeasures {
    std::size_t particles = 0;
    double coordination_number = 0; ///< contacts of interior grains, mean
    double pressure = 0;            ///< Pa, trace / 3 of the interior grains' normal forces times branches
    double unbalanced_force = 0;    ///< mean net normal force on interior grains / mean contact force
    /// The same of the skin's grains. They were in balance with the first box's interior, and do not move.
    double skin_unbalanced_force = 0;
    /// Of a variant: part of its interior's grains within half a mean radius of one of the first box's; some
    /// 0.1 would be so by chance.
    double kept_fraction = 1;
};
/// @param skin the first box's skin_rows(); in a variant the same rows
InteriorMeasures measure_interior(const PgBox& box, std::span<const std::uint8_t> skin, double thickness,
                                  const Material& material);

struct VariantSettings {
    double skin_thickness = 0; ///< m, at least twice the largest radius
    Material material;
    std::optional<double>
        coordination_tolerance;     ///< empty: the larger of 0.1 and 3.6 / sqrt(interior grains)
    double unbalanced_force = 5e-4; ///< of interior grains, at the end
    /// Starts and recompressions together. Empty: 8; below 1000 interior grains without friction 20.
    std::optional<std::int64_t> attempts = std::nullopt;
    std::int64_t iterations = 400000; ///< force evaluations at most, all attempts together
    std::uint64_t seed = 1;
    std::uint64_t number = 2; ///< which variant, 2 and up; 1 is the first box
};

struct VariantResult {
    PgBox box; ///< skin in the rows of the first box, bit for bit
    bool converged = false;
    std::string failure; ///< which measure fell short and by how much; empty where converged
    InteriorMeasures first, interior;
    double overcompression = 0;
    std::int64_t attempts = 0, iterations = 0;
};

/// May throw to stop; `fraction` of the work is an estimate.
using VariantObserver = std::function<void(const InteriorMeasures& state, double fraction)>;

/// Packs the interior anew between the frozen skin. Grains near the skin start from where they were, the
/// others at random places.
///
/// Without friction all are relaxed first at a solid fraction above the box's own, then at its own, as in
/// compress(); an attempt with too much pressure or too many contacts is shaken and pressed once more. Of all
/// attempts the one of least difference in pressure is taken whose coordination number is that of the first
/// box's interior. Both cannot be met: a grain that touches one that does not give way needs fewer contacts
/// than one whose partners are as free as itself (3 a grain against 6 a pair), so that with as many contacts
/// a variant's interior is under more pressure.
///
/// With friction grains find places free of overlap at 0.04 below the fraction and are grown from there by
/// the engine with friction on, skin fixed, until all is in balance.
///
/// Same settings, same bits, at any size of the team.
/// @throws Error(configuration_invalid) where the skin is too thin or leaves no interior
VariantResult make_variant(const PgBox& first, const VariantSettings& settings, ThreadTeam& team,
                           const VariantObserver& observer = {});

} // namespace talus::packing
