// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/together.hpp"

#include "base/error.hpp"

#include <exception>
#include <fmt/format.h>

namespace talus::io {

void all_or_none(const Together& together, const std::function<void()>& step) {
    if (together.alone())
        return step();
    std::string words; // the exit code, a blank, the message
    try {
        step();
    } catch (const Error& error) {
        words = fmt::format("{} {}", static_cast<int>(error.code()), error.what());
    } catch (const std::exception& error) {
        words = fmt::format("{} {}", static_cast<int>(ExitCode::run_failed), error.what());
    }
    words = together.agree(words);
    if (words.empty())
        return;
    std::size_t digits = 0;
    const int code = std::stoi(words, &digits);
    throw Error(static_cast<ExitCode>(code), words.substr(digits + 1));
}

std::string from_first(const Together& together, std::string text) {
    std::uint64_t size = text.size();
    together.broadcast(&size, sizeof size);
    text.resize(size);
    together.broadcast(text.data(), text.size());
    return text;
}

} // namespace talus::io
