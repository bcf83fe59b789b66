// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/chunk_press.hpp"
#include "io/hdf_file.hpp"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace talus::io {

/// A column [rows] or [rows][width] of unknown length that is written while it grows, whole chunks at a time:
/// what does not fill a chunk yet waits in memory. The file depends on the values only, not on how they came.
/// With a press chunks are written when it is flushed; until then appended values stay where they are.
template <class T>
class StreamedColumn {
public:
    static constexpr std::size_t default_chunk_bytes = std::size_t{4} << 20;

    /// @param chunk_bytes bytes of a chunk, about
    StreamedColumn(const hdf::Group& group, std::string name, std::string unit, hdf::Filter filter,
                   std::size_t width = 1, hdf::ChunkPress* press = nullptr,
                   std::size_t chunk_bytes = default_chunk_bytes)
        : group_(&group), name_(std::move(name)), unit_(std::move(unit)), filter_(filter), width_(width),
          chunk_rows_(rows_of_chunk(width, chunk_bytes)), press_(press) {}

    /// Bytes that a column without compression takes in a file, checksums included.
    static std::uint64_t plain_bytes(std::uint64_t rows, std::size_t width,
                                     std::size_t chunk_bytes = default_chunk_bytes) {
        constexpr std::uint64_t checksum = 4;
        const std::uint64_t chunk = rows_of_chunk(width, chunk_bytes), row = width * sizeof(T);
        if (rows < chunk)
            return rows == 0 ? 0 : rows * row + checksum;
        return (rows + chunk - 1) / chunk * (chunk * row + checksum);
    }

    /// @param values [rows][width]
    void append(const T* values, std::size_t rows) {
        const std::size_t missing = chunk_rows_ - waiting_.size() / width_;
        if (!waiting_.empty() && rows >= missing) {
            write(std::exchange(waiting_, {}), values);
            values += missing * width_;
            rows -= missing;
        }
        if (waiting_.empty()) // whole chunks pass without a copy
            for (; rows >= chunk_rows_; rows -= chunk_rows_, values += chunk_rows_ * width_)
                write({}, values);
        waiting_.insert(waiting_.end(), values, values + rows * width_);
    }

    /// Writes what still waits; a column of less than a chunk has one of its own length. Returns the dataset.
    hdf::Dataset& finish() {
        const std::size_t rows = waiting_.size() / width_;
        if (!dataset_) {
            const hdf::Dims dims = width_ > 1 ? hdf::Dims{rows, width_} : hdf::Dims{rows};
            dataset_ = group_->write(name_, waiting_.data(), dims, {.unit = unit_, .filter = filter_});
        } else if (rows > 0) {
            dataset_->append(waiting_.data(), rows);
        }
        std::vector<T>().swap(waiting_);
        return *dataset_;
    }

    /// Closes the dataset, so that where its last chunk lies does not depend on what is closed when.
    void close() { dataset_.reset(); }

private:
    static std::size_t rows_of_chunk(std::size_t width, std::size_t chunk_bytes) {
        return std::max<std::size_t>(1, chunk_bytes / (width * sizeof(T)));
    }
    /// A chunk: `head`, and what is missing of it from `rest`.
    void write(std::vector<T> head, const T* rest) {
        if (!dataset_) {
            const hdf::Dims none = width_ > 1 ? hdf::Dims{0, width_} : hdf::Dims{0};
            const hdf::Dims shape = width_ > 1 ? hdf::Dims{chunk_rows_, width_} : hdf::Dims{chunk_rows_};
            dataset_ = group_->create(name_, hdf::file_type<T>(), none,
                                      {.unit = unit_, .filter = filter_, .chunk = shape, .extendable = true});
        }
        const std::span tail(rest, chunk_rows_ * width_ - head.size());
        if (press_) {
            press_->add(*dataset_, filter_, sizeof(T), std::as_bytes(std::span(head)), std::as_bytes(tail));
        } else if (head.empty()) {
            dataset_->append(rest, chunk_rows_);
        } else {
            head.insert(head.end(), tail.begin(), tail.end());
            dataset_->append(head.data(), chunk_rows_);
        }
    }

    const hdf::Group* group_;
    std::string name_, unit_;
    hdf::Filter filter_;
    std::size_t width_, chunk_rows_;
    hdf::ChunkPress* press_;
    std::vector<T> waiting_;
    std::optional<hdf::Dataset> dataset_;
};

} // namespace talus::io
