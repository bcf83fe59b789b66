// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "particles/grains.hpp"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace talus::engine {

/// When a trigger's own time begins: so many seconds after the start of the run, or of the stage of that
/// name.
struct Onset {
    std::string stage; ///< empty: the run
    double delay = 0;  ///< s
};

/// Motion of the ground against an observer at rest: m s-2, m s-1, m.
struct GroundMotion {
    Vec3 acceleration, velocity, displacement;
};

/// A recorded ground motion: acceleration by time, linear between the samples, none before and after. The
/// ground is at rest before it; velocity and displacement are the exact integrals of what is interpolated.
class Accelerogram {
public:
    Accelerogram() = default;
    /// @param time s, rising; @param acceleration m s-2
    /// @throws Error(input_invalid) for fewer than 2 samples, columns of unequal length, numbers that are not
    /// finite, or times that do not rise
    Accelerogram(std::vector<double> time, std::vector<Vec3> acceleration);

    bool empty() const { return time_.empty(); }
    double duration() const { return empty() ? 0 : time_.back() - time_.front(); } ///< s
    double end() const { return empty() ? 0 : time_.back(); }                      ///< s, of the last sample
    double peak() const; ///< m s-2, largest magnitude
    /// @param time s, on the record's clock
    GroundMotion at(double time) const;

private:
    std::vector<double> time_;
    std::vector<Vec3> acceleration_, velocity_, displacement_;
};

/// Ground shaking. A run with it is computed in the frame of the ground: fixed grains and walls stand still,
/// and on every grain that may move acts the inertial force -m a(t).
struct Shaking {
    Onset onset;
    Accelerogram record;
};

/// A factor in time on the strength of bonds (P_b), of friction between grains, or of both.
struct StrengthReduction {
    Onset onset;
    std::vector<std::array<double, 2>> factor; ///< (s, factor in [0, 1]), times rising; linear in between,
                                               ///< constant before and after
    bool bond = true, friction = true;
    /// By number of the material: 1 for those that weaken. Empty: all.
    std::vector<std::uint8_t> of_material;

    double at(double time) const; ///< s, on its own clock
    bool covers(std::size_t material) const {
        return of_material.empty() || (material < of_material.size() && of_material[material] != 0);
    }
};

struct Scene;

/// Gives grains that weaken materials of their own, so that kernels find a pair's strength in the table of
/// constants: the scene gets copies of its materials for each set of reductions that a grain may be under.
/// @param inside of each reduction: 1 for the grains (rows) it weakens; empty: all grains, which takes no
/// copy
/// @returns the grains' new materials; empty where nothing changes
/// @throws Error(configuration_invalid) for more than 256 materials
std::vector<std::uint8_t> split_materials(Scene& scene, const Grains& grains,
                                          const std::vector<std::vector<std::uint8_t>>& inside);

} // namespace talus::engine
