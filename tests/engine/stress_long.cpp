// SPDX-License-Identifier: GPL-3.0-or-later
/// Numerical stability over very many steps (label long); shorter versions are in stress_steps.cpp.
#include "stress_table.hpp"

namespace talus::engine {
namespace {

using testing::expect_at_most;

TEST(LongStressChain, TenMillionStepsKeepTheEnergy) {
    const std::string what = "|energy / start - 1|";
    expect_at_most("elastic chain, 10^7 steps of 0.2 t_R", what, testing::elastic_chain_error(10000000, 0.2),
                   0.2);
    expect_at_most("elastic chain, 10^7 steps of 0.1 t_R", what, testing::elastic_chain_error(10000000, 0.1),
                   0.02);
}

TEST(LongStressPile, RestsForAMillionSteps) {
    const testing::PileAtRest pile = testing::pile_at_rest(120000, 1000000);
    expect_at_most("pile, 10^6 steps", "speed / sqrt(g r)", pile.speed, testing::rounding_speed);
    expect_at_most("pile, 10^6 steps", "drift / r", pile.drift, 1e-10);
    expect_at_most("pile, 10^6 steps", "settlement before / r", pile.settled, 1);
}

} // namespace
} // namespace talus::engine
