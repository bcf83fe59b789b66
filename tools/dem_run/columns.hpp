// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/error.hpp"
#include "io/checkpoint_file.hpp"
#include "parallel/communicator.hpp"

#include <cstring>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

namespace talus::dem_run {

/// Where this rank's rows of a table stand, which has `count` of them here. Collective.
inline io::Rows rows_of(std::size_t count, const parallel::Communicator& world) {
    io::Rows rows;
    const std::vector<std::uint64_t> counts = world.gather(std::uint64_t{count});
    for (std::size_t r = 0; r < counts.size(); ++r) {
        rows.total += counts[r];
        rows.first += r < static_cast<std::size_t>(world.rank()) ? counts[r] : 0;
    }
    return rows;
}

/// Small arrays of Scalar as a checkpoint's column, an array a row.
template <class Scalar, class Value>
io::Column as_column(const std::string& name, const std::vector<Value>& values, const std::string& unit = "",
                     io::Rows rows = {}) {
    static_assert(sizeof(Value) % sizeof(Scalar) == 0 && std::is_trivially_copyable_v<Value>);
    constexpr std::size_t width = sizeof(Value) / sizeof(Scalar);
    const auto* scalars = reinterpret_cast<const Scalar*>(values.data());
    std::vector<Scalar> data(scalars, scalars + values.size() * width);
    return {name, std::move(data), width, unit, rows};
}

/// And back.
/// @throws Error(input_invalid) for a column of another type or width
template <class Scalar, class Value>
void from_column(const io::Column& column, std::vector<Value>& values) {
    const auto* data = std::get_if<std::vector<Scalar>>(&column.data);
    constexpr std::size_t width = sizeof(Value) / sizeof(Scalar);
    if (data == nullptr || column.width != width)
        throw Error(ExitCode::input_invalid,
                    "checkpoint: column " + column.name + " has the wrong type or width");
    values.resize(data->size() / width);
    if (!data->empty())
        std::memcpy(static_cast<void*>(values.data()), data->data(), data->size() * sizeof(Scalar));
}

} // namespace talus::dem_run
