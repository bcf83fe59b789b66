// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace talus::cli {

/// Counted from 1; columns count characters (UTF-8 code points), not bytes.
struct Place {
    int line = 1, column = 1;
};

/// Where the byte at `offset` stands.
Place place_of(std::string_view text, std::size_t offset);

/// Where a value and its key stand in a JSON text.
struct ValuePlace {
    Place key, value;
};

/// What nlohmann-json does not keep: the places of all values, by JSON pointer ("" is the whole,
/// "/walls/0/name").
struct Places {
    std::map<std::string, ValuePlace> values;
    std::vector<std::string>
        duplicates; ///< pointers of keys that came a second time (their place: the last one)
};

/// Walks a text that is known to be valid JSON with // and /* */ comments.
Places locate(std::string_view text);

/// A pointer with one more key, escaped as RFC 6901 says (~ as ~0, / as ~1).
std::string child_pointer(const std::string& pointer, std::string_view key);

} // namespace talus::cli
