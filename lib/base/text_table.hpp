// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace talus {

/// Comma-separated text with one header line, as laboratories and spreadsheets write it: columns in any
/// order, empty lines and lines that begin with '#' passed over, quotes and a byte-order mark dropped. Views
/// point into the text given.
class TextTable {
public:
    struct Row {
        std::size_t line; ///< in the file, from 1
        std::vector<std::string_view> fields;
    };

    /// @param name of the file, for messages
    /// @throws Error(input_invalid) "name:line: ..." where a line has more or fewer fields than the header
    TextTable(std::string_view text, std::string name);

    const std::vector<Row>& rows() const { return rows_; }
    std::size_t header_line() const { return header_line_; } ///< the last one where there is no header
    bool empty() const { return columns_.empty(); }
    const std::vector<std::string_view>& columns() const { return columns_; } ///< their names

    /// Place of a column in every row; empty where there is none.
    /// @throws Error(input_invalid) where it is there twice
    std::optional<std::size_t> find(std::string_view column) const;
    /// "name:line: what", exit code input_invalid.
    [[noreturn]] void fail(std::size_t line, const std::string& what) const;

private:
    std::string name_;
    std::size_t header_line_ = 1;
    std::vector<std::string_view> columns_;
    std::vector<Row> rows_;
};

/// A plain decimal number; empty where the text is anything else or not finite.
std::optional<double> plain_number(std::string_view text);

} // namespace talus
