// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdlib>
#include <new>
#include <sys/mman.h>
#include <utility>
#include <vector>

namespace talus {

/// Memory for columns that vector code streams through: starts on a cache line, so that no record straddles
/// two, and asks the system for huge pages where it is large (fewer misses of the address cache in scenes
/// that do not fit into the caches). New elements of trivial types are left as they are: whoever resizes,
/// writes.
template <class T>
struct ColumnAllocator {
    using value_type = T;
    ColumnAllocator() = default;
    template <class U>
    ColumnAllocator(const ColumnAllocator<U>&) {}

    T* allocate(std::size_t n) {
        constexpr std::size_t huge = std::size_t{2} << 20;
        if (n > (std::size_t{1} << 60) / sizeof(T))
            throw std::bad_array_new_length();
        const std::size_t bytes = n * sizeof(T);
        const std::size_t alignment = bytes >= huge / 2 ? huge : 64;
        void* memory = std::aligned_alloc(alignment, (bytes + alignment - 1) / alignment * alignment);
        if (memory == nullptr)
            throw std::bad_alloc();
        if (alignment == huge)
            madvise(memory, bytes, MADV_HUGEPAGE); // a wish: its failure costs speed only
        return static_cast<T*>(memory);
    }
    void deallocate(T* memory, std::size_t) { std::free(memory); }

    template <class U, class... Arguments>
    void construct(U* element, Arguments&&... arguments) {
        if constexpr (sizeof...(arguments) > 0 || !std::is_trivially_copyable_v<U>)
            ::new (static_cast<void*>(element)) U(std::forward<Arguments>(arguments)...);
    }
    bool operator==(const ColumnAllocator&) const { return true; }
};

/// A vector for ColumnAllocator's memory.
template <class T>
using Column = std::vector<T, ColumnAllocator<T>>;

/// Resizes a column whose contents are about to be written anew: room is made once, with a little to spare,
/// and nothing is copied.
template <class T>
void fit(Column<T>& column, std::size_t size) {
    if (size > column.capacity()) {
        column = Column<T>();
        column.reserve(size + size / 200);
    }
    column.resize(size);
}

} // namespace talus
