// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/trajectory_image.hpp"

#include "base/error.hpp"
#include "io/atomic_file.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fmt/format.h>
#include <unistd.h>

namespace talus::io {
namespace {

constexpr const char* length_name = "trajectory/length";
constexpr const char* ranges_name = "trajectory/ranges";
constexpr const char* bytes_name = "trajectory/bytes";

/// Of what precedes a range, so many bytes are in the image as well (a chunk ends with its checksum): they
/// tell whether the file is the one that the image was taken of.
constexpr std::uint64_t sample = 4;

[[noreturn]] void refuse(const AtomicFile& file, const std::string& what) {
    throw Error(ExitCode::input_invalid,
                fmt::format("{}: {}; put back the file of the run that wrote the checkpoint, or start anew",
                            file.partial(), what));
}

[[noreturn]] void fail(const AtomicFile& file, const char* doing) {
    throw Error(ExitCode::run_failed, fmt::format("{}: cannot be {}: {}; look after the disk and run again",
                                                  file.partial(), doing, std::strerror(errno)));
}

void read_at(const AtomicFile& file, std::uint64_t offset, std::uint8_t* to, std::uint64_t size) {
    while (size > 0) {
        const ssize_t got = ::pread(file.descriptor(), to, size, static_cast<off_t>(offset));
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            fail(file, "read");
        to += got;
        offset += static_cast<std::uint64_t>(got);
        size -= static_cast<std::uint64_t>(got);
    }
}

void write_at(const AtomicFile& file, std::uint64_t offset, const std::uint8_t* from, std::uint64_t size) {
    while (size > 0) {
        const ssize_t put = ::pwrite(file.descriptor(), from, size, static_cast<off_t>(offset));
        if (put < 0 && errno == EINTR)
            continue;
        if (put <= 0)
            fail(file, "written");
        from += put;
        offset += static_cast<std::uint64_t>(put);
        size -= static_cast<std::uint64_t>(put);
    }
}

template <class T>
std::vector<T> values_of(const CheckpointReader& checkpoint, const char* name) {
    Column column = checkpoint.read(name);
    auto* values = std::get_if<std::vector<T>>(&column.data);
    if (!values)
        throw Error(ExitCode::input_invalid,
                    fmt::format("checkpoint: column {}: has another type than this version of the program "
                                "writes; start anew from the model",
                                name));
    return std::move(*values);
}

/// Bytes up to the last that is in the file alone, or tells whose file it is.
std::uint64_t length_of_lasting(const TrajectoryImage& image) {
    std::uint64_t end = 0, needed = 0;
    for (const Extent& range : image.ranges) {
        if (range.offset > end)
            needed = range.offset + sample;
        end = range.offset + range.size;
    }
    return image.length > end ? image.length : needed;
}

bool consistent(const TrajectoryImage& image) {
    std::uint64_t end = 0, size = 0;
    for (const Extent& range : image.ranges) {
        if (range.offset < end || range.offset > image.length || range.size > image.length - range.offset ||
            (range.offset > end && range.size < sample))
            return false;
        end = range.offset + range.size;
        size += range.size;
    }
    return size == image.bytes.size();
}

} // namespace

void put(CheckpointFile& file, const TrajectoryImage& image) {
    std::vector<std::uint64_t> ranges;
    for (const Extent& range : image.ranges)
        ranges.insert(ranges.end(), {range.offset, range.size});
    file.columns.push_back({length_name, std::vector<std::uint64_t>{image.length}, 1, "", {}});
    file.columns.push_back({ranges_name, std::move(ranges), 2, "", {}});
    file.columns.push_back({bytes_name, image.bytes, 1, "", {}});
}

std::optional<TrajectoryImage> trajectory_image(const CheckpointReader& checkpoint) {
    if (!checkpoint.has(length_name))
        return std::nullopt;
    TrajectoryImage image;
    for (const std::uint64_t length : values_of<std::uint64_t>(checkpoint, length_name))
        image.length = length;
    const auto ranges = values_of<std::uint64_t>(checkpoint, ranges_name);
    for (std::size_t r = 0; r + 1 < ranges.size(); r += 2)
        image.ranges.push_back({ranges[r], ranges[r + 1]});
    image.bytes = values_of<std::uint8_t>(checkpoint, bytes_name);
    return image;
}

std::vector<Extent> complement(std::vector<Extent> extents, std::uint64_t length) {
    std::sort(extents.begin(), extents.end());
    std::vector<Extent> gaps;
    std::uint64_t end = 0;
    for (const Extent& extent : extents) {
        if (extent.offset > end)
            gaps.push_back({end, extent.offset - end});
        end = std::max(end, extent.offset + extent.size);
    }
    if (length > end)
        gaps.push_back({end, length - end});
    return gaps;
}

TrajectoryImage capture(const AtomicFile& file, const std::vector<Extent>& lasting) {
    file.sync();
    TrajectoryImage image;
    image.length = file.length();
    std::uint64_t end = 0;
    for (Extent range : complement(lasting, image.length)) {
        if (range.offset > end) {
            const std::uint64_t taken = std::min(sample, range.offset - end);
            range = {range.offset - taken, range.size + taken};
        }
        end = range.offset + range.size;
        image.ranges.push_back(range);
        image.bytes.resize(image.bytes.size() + range.size);
        read_at(file, range.offset, image.bytes.data() + image.bytes.size() - range.size, range.size);
    }
    return image;
}

void restore(const AtomicFile& file, const TrajectoryImage& image) {
    if (!consistent(image))
        throw Error(
            ExitCode::input_invalid,
            fmt::format("{}: the checkpoint's image of it contradicts itself; start anew from the model",
                        file.partial()));
    // HDF5 cuts off room that it took and did not use when it closes the file: only what lasts must be there.
    const std::uint64_t length = file.length(), needed = length_of_lasting(image);
    if (length < needed)
        refuse(file, fmt::format("has {} bytes, at the checkpoint it had {}", length, image.length));
    const std::uint8_t* from = image.bytes.data();
    std::uint64_t end = 0;
    for (const Extent& range : image.ranges) {
        if (range.offset > end) {
            std::array<std::uint8_t, sample> present{};
            read_at(file, range.offset, present.data(), sample);
            if (std::memcmp(present.data(), from, sample) != 0)
                refuse(file, fmt::format("holds other data before byte {} than at the checkpoint, it is that "
                                         "of another run",
                                         range.offset + sample));
        }
        end = range.offset + range.size;
        from += range.size;
    }
    from = image.bytes.data();
    for (const Extent& range : image.ranges) {
        write_at(file, range.offset, from, range.size);
        from += range.size;
    }
    if (::ftruncate(file.descriptor(), static_cast<off_t>(image.length)) != 0)
        fail(file, "cut to its length");
}

} // namespace talus::io
