// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/chunk_press.hpp"

#include "base/memory.hpp"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <cstring>
#include <libdeflate.h>
#include <memory>
#include <mutex>
#include <new>

namespace talus::io::hdf {
namespace {

constexpr int deflate_level = 1;

/// One a thread: they cannot be shared.
libdeflate_compressor& compressor() {
    struct Free {
        void operator()(libdeflate_compressor* c) const { libdeflate_free_compressor(c); }
    };
    thread_local const std::unique_ptr<libdeflate_compressor, Free> own(
        libdeflate_alloc_compressor(deflate_level));
    if (!own)
        throw std::bad_alloc();
    return *own;
}

/// HDF5's shuffle: first byte of all values, second byte of all ...
void shuffle(std::span<const std::byte> values, std::size_t value_size, std::byte* out) {
    const std::size_t n = values.size() / value_size;
    constexpr std::size_t block = 512; // values whose bytes stay in the nearest cache meanwhile
    for (std::size_t first = 0; first < n; first += block) {
        const std::size_t last = std::min(n, first + block);
        for (std::size_t k = 0; k < value_size; ++k)
            for (std::size_t i = first; i < last; ++i)
                out[k * n + i] = values[i * value_size + k];
    }
}

/// Fletcher's checksum of 16-bit words, the first byte of each the high one: both sums modulo 65535, where
/// only sums of nothing but zeros give 0.
std::uint32_t fletcher32(std::span<const std::byte> data) {
    constexpr std::size_t block = 256; // 256 * 257 / 2 * 65535 fits into 32 bits
    constexpr std::uint64_t modulus = 65535;
    const auto word = [&](std::size_t k) {
        std::uint16_t w = 0;
        std::memcpy(&w, data.data() + 2 * k, 2);
        return static_cast<std::uint32_t>(static_cast<std::uint16_t>(w << 8 | w >> 8)); // little-endian host
    };
    const auto reduced = [](std::uint64_t sum) { return sum == 0 ? sum : (sum - 1) % modulus + 1; };
    std::uint64_t first = 0, second = 0;
    const std::size_t words = data.size() / 2;
    for (std::size_t k = 0; k < words; k += block) {
        const std::size_t n = std::min(block, words - k);
        std::uint32_t plain = 0, weighted = 0;
        for (std::size_t j = 0; j < n; ++j) {
            const std::uint32_t w = word(k + j);
            plain += w;
            weighted += static_cast<std::uint32_t>(n - j) * w;
        }
        second = reduced(second + n * first + weighted);
        first = reduced(first + plain);
    }
    if (data.size() % 2 != 0) {
        first = reduced(first + (std::to_integer<std::uint64_t>(data.back()) << 8));
        second = reduced(second + first);
    }
    return static_cast<std::uint32_t>(second << 16 | first);
}

/// A chunk put through the filters of Group::create(), as HDF5 would undo them, with memory that is used
/// again.
class Press {
public:
    /// @param values of a chunk: both together
    void press(std::span<const std::byte> head, std::span<const std::byte> rest, std::size_t value_size,
               Filter filter) {
        std::span<const std::byte> data = rest;
        if (!head.empty()) {
            resize_anew(joined_, head.size() + rest.size());
            std::copy(rest.begin(), rest.end(), std::copy(head.begin(), head.end(), joined_.begin()));
            data = joined_;
        }
        resize_anew(stored_, data.size() + checksum_size);
        size_ = 0;
        filter_mask_ = 0;
        if (filter == Filter::compressed) {
            if (value_size > 1) {
                resize_anew(shuffled_, data.size());
                shuffle(data, value_size, shuffled_.data());
                data = shuffled_;
            }
            size_ = libdeflate_zlib_compress(&compressor(), data.data(), data.size(), stored_.data(),
                                             data.size() - 1);
            if (size_ == 0) // it would not be shorter
                filter_mask_ = without_deflate;
        }
        if (size_ == 0) {
            size_ = data.size();
            std::copy(data.begin(), data.end(), stored_.begin());
        }
        const std::uint32_t checksum = fletcher32({stored_.data(), size_});
        for (std::size_t k = 0; k < checksum_size; ++k)
            stored_[size_++] = static_cast<std::byte>(checksum >> 8 * k & 0xffu);
    }
    /// The chunk as it is to lie in the file.
    std::span<const std::byte> stored() const { return {stored_.data(), size_}; }
    unsigned filter_mask() const { return filter_mask_; }

private:
    static constexpr std::size_t checksum_size = 4;
    static constexpr unsigned without_deflate = 1u << 1; ///< its place among the filters
    std::vector<std::byte> joined_, shuffled_, stored_;
    std::size_t size_ = 0;
    unsigned filter_mask_ = 0;
};

} // namespace

void ChunkPress::flush() {
    std::atomic<std::size_t> next{0};
    std::mutex guard;
    std::condition_variable turn;
    std::size_t written = 0;
    bool failed = false;
    team_->run([&](int) {
        Press press;
        for (std::size_t k = next++; k < queue_.size(); k = next++) {
            Chunk& chunk = queue_[k];
            std::unique_lock lock(guard, std::defer_lock);
            try {
                press.press(chunk.head, chunk.rest, chunk.value_size, chunk.filter);
                std::vector<std::byte>().swap(chunk.head);
                lock.lock();
                turn.wait(lock, [&] { return failed || written == k; });
                if (failed)
                    return;
                chunk.dataset->append_chunk(press.stored(), press.filter_mask());
                ++written;
            } catch (...) {
                if (!lock)
                    lock.lock();
                failed = true;
                turn.notify_all();
                throw;
            }
            turn.notify_all();
        }
    });
    queue_.clear();
}

} // namespace talus::io::hdf
