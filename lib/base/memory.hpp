// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

namespace talus {

/// Most memory that this process has had at once, bytes.
std::uint64_t peak_memory();

/// From now on blocks of so many bytes and more return to the system as soon as they are freed, so that what
/// a process needs at most can be foretold. Otherwise the C library keeps freed blocks of up to 32 MiB, and
/// may hold twice what is in use. For a program whose large blocks live long.
void give_back_large_blocks(int bytes);

/// As many values, whatever they are: no more memory than that, and what does not suffice is given back
/// first.
template <class T>
void resize_anew(std::vector<T>& values, std::size_t count) {
    if (count > values.capacity())
        std::vector<T>().swap(values); // assigning {} would keep the memory
    values.resize(count);
}

} // namespace talus
