// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/family.hpp"

#include "base/error.hpp"
#include "particles/seams.hpp"

#include <fmt/format.h>
#include <map>

namespace talus::tiling {

namespace {

constexpr const char* cure = "give the boxes of one pgbox-gen --variants run, each once";

template <class T>
const T& attribute(const io::PgBoxFile& file, const std::string& path, const char* name) {
    const auto at = file.attributes.find(name);
    if (at != file.attributes.end())
        if (const auto* value = std::get_if<T>(&at->second))
            return *value;
    throw Error(
        ExitCode::input_invalid,
        fmt::format("{}: /granular/pgbox has no attribute {}, which boxes that are drawn per tile need; {}",
                    path, name, cure));
}

} // namespace

void require_one_family(std::span<const io::PgBoxFile> files, std::span<const std::string> path) {
    if (files.size() < 2)
        return;
    const auto& family = attribute<std::string>(files[0], path[0], "family");
    std::map<std::int64_t, std::size_t> seen;
    for (std::size_t k = 0; k < files.size(); ++k) {
        const auto& other = attribute<std::string>(files[k], path[k], "family");
        if (other != family)
            throw Error(ExitCode::input_invalid,
                        fmt::format("{}: family {} is not that of {}, {}: their faces do not fit; {}",
                                    path[k], other, path[0], family, cure));
        const auto variant = attribute<std::int64_t>(files[k], path[k], "variant");
        if (const auto [at, fresh] = seen.emplace(variant, k); !fresh)
            throw Error(ExitCode::input_invalid, fmt::format("{}: variant {}, as is {}; {}", path[k], variant,
                                                             path[at->second], cure));
        if (k > 0)
            if (const auto difference = seam_difference(files[0].box, files[k].box))
                throw Error(ExitCode::input_invalid,
                            fmt::format("{}: does not fit {}: {}; {}", path[k], path[0], *difference, cure));
    }
}

double skin_thickness(const io::PgBoxFile& file) {
    const auto at = file.attributes.find("skin_thickness");
    if (at == file.attributes.end())
        return 0;
    const auto* value = std::get_if<double>(&at->second);
    return value == nullptr ? 0 : *value;
}

} // namespace talus::tiling
