// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "parallel/communicator.hpp"

namespace talus::testing {

/// All ranks of the test program.
const parallel::Communicator& world();

} // namespace talus::testing
