// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "parallel/communicator.hpp"

#include <memory>
#include <span>

namespace talus::parallel {

/// Which part of space is whose: recursive coordinate bisection by Zoltan (Berger & Bokhari, IEEE Trans.
/// Comput. C-36 (1987); Devine et al., Comput. Sci. Eng. 4 (2002)). Together the parts are all of space;
/// those without points may be empty.
class Domains {
public:
    explicit Domains(const Communicator& world);
    ~Domains();
    Domains(const Domains&) = delete;
    Domains& operator=(const Domains&) = delete;

    /// Cuts space anew so that the sums of the weights are alike. Collective.
    /// @param points  m, this rank's; any rank may have any
    /// @param weights as many, above zero
    void cut(std::span<const Vec3> points, std::span<const float> weights);
    /// Whose part a point is in.
    int rank_of(const Vec3& point) const;

private:
    struct State;
    std::unique_ptr<State> state_;
};

} // namespace talus::parallel
