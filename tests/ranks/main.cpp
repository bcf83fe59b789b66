// SPDX-License-Identifier: GPL-3.0-or-later
/// Tests that several ranks run together: mpirun -n P test_ranks. A failure on any rank is one of all.
#include "world.hpp"

#include <gtest/gtest.h>

namespace talus::testing {

const parallel::Communicator& world() {
    static const parallel::Communicator all = parallel::Communicator::world();
    return all;
}

} // namespace talus::testing

int main(int argc, char** argv) {
    ::testing::InitGoogleTest(&argc, argv);
    const talus::parallel::Communicator world = talus::testing::world();
    if (world.rank() != 0)
        delete ::testing::UnitTest::GetInstance()->listeners().Release(
            ::testing::UnitTest::GetInstance()->listeners().default_result_printer());
    const int failed = RUN_ALL_TESTS();
    if (failed != 0 && world.rank() != 0)
        std::fprintf(stderr, "rank %d: failed\n", world.rank());
    return world.any(failed != 0) ? 1 : 0;
}
