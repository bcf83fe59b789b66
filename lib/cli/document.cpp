// SPDX-License-Identifier: GPL-3.0-or-later
#include "cli/document.hpp"
#include <algorithm>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <sys/stat.h>
#include <unistd.h>

namespace talus::cli {
namespace {

using Json = nlohmann::ordered_json;

/// Accepts everything; keeps where and why the text is not JSON.
struct SyntaxCheck : nlohmann::json_sax<Json> {
    std::size_t position = 0;
    std::string message;
    int depth = 0;
    bool null() override { return true; }
    bool boolean(bool) override { return true; }
    bool number_integer(number_integer_t) override { return true; }
    bool number_unsigned(number_unsigned_t) override { return true; }
    bool number_float(number_float_t, const string_t&) override { return true; }
    bool string(string_t&) override { return true; }
    bool binary(binary_t&) override { return true; }
    bool start_object(std::size_t) override { return deeper(); }
    bool key(string_t&) override { return true; }
    bool end_object() override { return --depth, true; }
    bool start_array(std::size_t) override { return deeper(); }
    bool end_array() override { return --depth, true; }
    /// The locator recurses, so the depth is bounded.
    bool deeper() {
        if (++depth <= 64)
            return true;
        message = "found values nested more than 64 deep, expected fewer";
        return false;
    }
    bool parse_error(std::size_t at, const std::string&, const nlohmann::json::exception& error) override {
        position = at;
        message = error.what();
        return false;
    }
};

/// Control characters of a key or value must not break the line (or colour the terminal).
std::string one_line(std::string text) {
    for (char& c : text)
        if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
            c = ' ';
    return text;
}

/// The part of nlohmann's message that helps: without its number, its own count of lines, and raw bytes.
std::string plain(std::string message) {
    if (const auto bracket = message.find("] "); bracket != std::string::npos)
        message.erase(0, bracket + 2);
    if (message.starts_with("parse error"))
        message.erase(0, message.find(": ") == std::string::npos ? 0 : message.find(": ") + 2);
    return one_line(std::move(message));
}

/// Where the faulty token begins. `read` counts the bytes up to its end.
std::size_t fault_begin(const std::string& text, std::size_t read, const std::string& message) {
    if (read > text.size())
        return text.size();
    std::size_t begin = read > 0 ? read - 1 : 0;
    if (message.find("number") != std::string::npos)
        while (begin > 0 &&
               std::string_view("+-.eE0123456789").find(text[begin - 1]) != std::string_view::npos)
            --begin;
    else if (message.find("string literal;") != std::string::npos && begin > 0 && text[begin] == '"')
        if (const auto quote = text.rfind('"', begin - 1); quote != std::string::npos)
            begin = quote;
    return begin;
}

std::string slurp(const std::string& path) {
    const auto bad = [&](const char* why) {
        return Error(ExitCode::input_invalid,
                     fmt::format("{}: configuration file cannot be read: {}", path, why));
    };
    std::FILE* file = std::fopen(path.c_str(), "rb");
    if (!file)
        throw bad(std::strerror(errno));
    std::string text;
    char buffer[65536];
    for (std::size_t n; (n = std::fread(buffer, 1, sizeof buffer, file)) > 0;)
        text.append(buffer, n);
    const int error = std::ferror(file) ? errno : 0;
    std::fclose(file);
    if (error)
        throw bad(std::strerror(error));
    return text;
}

bool is_below(const std::string& pointer, const std::string& above) {
    return pointer.size() >= above.size() && pointer.compare(0, above.size(), above) == 0 &&
           (pointer.size() == above.size() || pointer[above.size()] == '/');
}

std::string parent_of(const std::string& pointer) {
    return pointer.substr(0, pointer.rfind('/'));
}

std::vector<std::string> split(std::string_view dotted) {
    std::vector<std::string> parts;
    for (std::size_t begin = 0;;) {
        const auto end = dotted.find('.', begin);
        parts.emplace_back(dotted.substr(begin, end - begin));
        if (end == std::string_view::npos)
            return parts;
        begin = end + 1;
    }
}

} // namespace

Document::Document(std::string program)
    : program_(std::move(program)), root_(std::make_unique<Json>(Json::object())) {}
Document::~Document() = default;

std::vector<Problem> Document::read_file(const std::string& path) {
    return read_text(path, slurp(path));
}

std::vector<Problem> Document::read_text(const std::string& path, std::string text) {
    path_ = path;
    const auto at = [&](Place place, const std::string& message) {
        return Problem{ExitCode::configuration_invalid, place,
                       fmt::format("{}:{}:{}: error: {}", path, place.line, place.column, message)};
    };
    SyntaxCheck check;
    if (!Json::sax_parse(text, &check, Json::input_format_t::json, true, true)) {
        readable_ = false;
        const std::size_t start = fault_begin(text, check.position, check.message);
        return {at(place_of(text, start), "/: " + plain(check.message))};
    }
    *root_ = Json::parse(text, nullptr, true, true);
    places_ = locate(text);
    std::vector<Problem> problems;
    for (const std::string& pointer : places_.duplicates)
        problems.push_back(
            problem(pointer, "found a second time, expected once (the last would silently win)", true));
    if (!root_->is_object()) {
        problems.push_back(
            problem("", fmt::format("found {}, expected an object {{...}}", root_->type_name())));
        *root_ = Json::object();
    }
    return problems;
}

std::vector<Problem> Document::assign(const std::string& dotted, const std::string& text,
                                      const std::string& source, bool verbatim) {
    const auto bad = [&](const std::string& message) {
        return std::vector<Problem>{{ExitCode::usage, Place{0, 0},
                                     one_line(fmt::format("{}: error: {}: {}", program_, source, message))}};
    };
    Json value = text;
    const auto first = text.find_first_not_of(" \t");
    if (!verbatim && first != std::string::npos && (text[first] == '[' || text[first] == '{')) {
        value = Json::parse(text, nullptr, false, true);
        if (value.is_discarded())
            return bad(fmt::format("found {}, expected valid JSON after the bracket", text));
    }
    const bool remove = !verbatim && text == "null";
    const std::string pointer = pointer_of(dotted);
    Json* node = root_.get();
    std::string here;
    const std::vector<std::string> parts = split(dotted);
    for (const std::string& part : parts) {
        const bool last = &part == &parts.back();
        here = child_pointer(here, part);
        if (node->is_array()) {
            std::size_t index = 0;
            const auto [end, status] = std::from_chars(part.data(), part.data() + part.size(), index);
            if (status != std::errc{} || end != part.data() + part.size() || index > node->size())
                return bad(
                    fmt::format("found element \"{}\", expected a number from 0 to {}", part, node->size()));
            if (index == node->size()) {
                node->push_back(Json::object());
            }
            if (last && remove) {
                node->erase(index);
                return {};
            }
            node = &(*node)[index];
        } else if (node->is_object()) {
            if (last && remove) {
                node->erase(part);
                std::erase_if(sources_, [&](const auto& entry) { return is_below(entry.first, pointer); });
                return {};
            }
            if (!node->contains(part)) {
                // A number as the next part makes an array, a name an object.
                const std::string next =
                    last ? std::string() : parts[static_cast<std::size_t>(&part - parts.data()) + 1];
                (*node)[part] = !next.empty() && next.find_first_not_of("0123456789") == std::string::npos
                                    ? Json::array()
                                    : Json::object();
            }
            node = &(*node)[part];
        } else {
            return {}; // what the file has in its place is reported as a wrong type
        }
    }
    *node = std::move(value);
    std::erase_if(sources_, [&](const auto& entry) { return is_below(entry.first, pointer); });
    sources_[pointer] = source;
    return {};
}

const Json* Document::find(const std::string& pointer) const {
    const Json::json_pointer path(pointer);
    return root_->contains(path) ? &root_->at(path) : nullptr;
}

std::string Document::source_of(const std::string& pointer, std::string* where) const {
    for (std::string at = pointer;; at = parent_of(at)) {
        if (const auto found = sources_.find(at); found != sources_.end()) {
            if (where)
                *where = at;
            return found->second;
        }
        if (at.empty())
            return {};
    }
}

bool Document::from_command_line(const std::string& pointer) const {
    return !source_of(pointer, nullptr).empty();
}

Problem Document::problem(const std::string& pointer, const std::string& raw_message, bool at_key) const {
    std::string where;
    const std::string source = one_line(source_of(pointer, &where));
    const std::string message = one_line(raw_message);
    const std::string name = one_line(pointer.empty() ? "/" : pointer);
    if (!source.empty()) {
        const std::string deeper = where == pointer ? std::string() : name + ": ";
        return {ExitCode::usage, Place{0, 0},
                fmt::format("{}: error: {}: {}{}", program_, source, deeper, message)};
    }
    if (path_.empty())
        return {ExitCode::usage, Place{0, 0}, fmt::format("{}: error: {}: {}", program_, name, message)};
    for (std::string at = pointer;; at = parent_of(at)) {
        const auto found = places_.values.find(at);
        if (found == places_.values.end() && !at.empty())
            continue;
        Place place;
        if (found != places_.values.end())
            place = at_key ? found->second.key : found->second.value;
        return {ExitCode::configuration_invalid, place,
                fmt::format("{}:{}:{}: error: {}: {}", path_, place.line, place.column, name, message)};
    }
}

std::string pointer_of(std::string_view dotted) {
    std::string pointer;
    for (const std::string& part : split(dotted))
        pointer = child_pointer(pointer, part);
    return pointer;
}

} // namespace talus::cli
