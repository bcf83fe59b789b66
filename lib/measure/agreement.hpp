// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "terrain/outline.hpp"
#include "terrain/raster.hpp"

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace talus::measure {

/// A computed footprint against an observed one, by area. The scores follow from TP, FP and FN alone; cells
/// where neither has anything count only where a domain was stated.
struct Agreement {
    double true_positive_area = 0, false_positive_area = 0, false_negative_area = 0; ///< m2
    std::optional<double> true_negative_area; ///< m2, within the stated domain
    double intersection_over_union = 0;       ///< TP / (TP + FP + FN)
    double critical_success_index = 0;        ///< TP / (TP + FP + FN): the same by another name
    double precision = 0; ///< TP / (TP + FP), share of what was computed that was observed
    double recall = 0;    ///< TP / (TP + FN), share of what was observed that was computed
};

/// @param computed, observed  [cells], 1 inside
/// @param domain  [cells] or empty: cells that are compared at all; without it all cells are, and no true
/// negatives
///                are given
/// Scores of two empty footprints are 1 (they agree); otherwise a score without a denominator is 0.
/// @throws Error(input_invalid) where the lengths differ
Agreement compare_footprints(std::span<const std::uint8_t> computed, std::span<const std::uint8_t> observed,
                             double cell_area, std::span<const std::uint8_t> domain = {});

/// Cells with data whose value is at least `threshold` away from zero; with a threshold of 0, not zero.
std::vector<std::uint8_t> cells_beyond(const terrain::Raster& raster, double threshold);

/// Cells whose centre lies in the outline (map coordinates).
std::vector<std::uint8_t> cells_inside(const terrain::Outline& outline, const terrain::Raster& like);

/// Computed and observed change of elevation, cell by cell; cells without data count as no change.
struct ChangeAgreement {
    Agreement deposit, excavation; ///< cells at or beyond +threshold, -threshold
    double observed_excavated_volume = 0, observed_deposited_volume = 0; ///< m3
    double root_mean_square = 0; ///< m, of the difference over the cells where either is not zero
};
/// @throws Error(input_invalid) where the rasters are not on one grid
ChangeAgreement compare_changes(const terrain::Raster& computed, const terrain::Raster& observed,
                                double threshold);

} // namespace talus::measure
