// SPDX-License-Identifier: GPL-3.0-or-later
#include "cli/locator.hpp"
#include <nlohmann/json.hpp>

namespace talus::cli {
namespace {

class Walker {
public:
    explicit Walker(std::string_view text) : text_(text) {
        if (text_.starts_with("\xEF\xBB\xBF"))
            at_ = 3;
    }

    Places walk() {
        skip();
        value("", place());
        return std::move(places_);
    }

private:
    /// Moves past white space and comments, keeping the count of lines.
    void skip() {
        while (at_ < text_.size()) {
            const char c = text_[at_];
            if (c == ' ' || c == '\t' || c == '\r' || c == '\n') {
                ++at_;
            } else if (text_.substr(at_).starts_with("//")) {
                at_ = std::min(text_.find('\n', at_), text_.size());
            } else if (text_.substr(at_).starts_with("/*")) {
                const auto end = text_.find("*/", at_ + 2);
                at_ = end == std::string_view::npos ? text_.size() : end + 2;
            } else {
                return;
            }
        }
    }

    /// The place of the next byte; only ever asked forwards, so the text is counted once.
    Place place() {
        for (; counted_ < at_; ++counted_) {
            if (text_[counted_] == '\n')
                ++current_.line, current_.column = 1;
            else if ((static_cast<unsigned char>(text_[counted_]) & 0xC0) != 0x80 && counted_ >= bom())
                ++current_.column;
        }
        return current_;
    }
    std::size_t bom() const { return text_.starts_with("\xEF\xBB\xBF") ? 3 : 0; }

    std::string_view string() {
        const std::size_t begin = at_++;
        while (at_ < text_.size() && text_[at_] != '"')
            at_ += text_[at_] == '\\' ? 2 : 1;
        ++at_;
        return text_.substr(begin, at_ - begin);
    }

    char peek() const { return at_ < text_.size() ? text_[at_] : '\0'; }

    void value(const std::string& pointer, Place key) {
        const Place here = place();
        if (!places_.values.insert_or_assign(pointer, ValuePlace{key, here}).second)
            places_.duplicates.push_back(pointer);
        if (peek() == '{')
            object(pointer);
        else if (peek() == '[')
            array(pointer);
        else if (peek() == '"')
            string();
        else
            at_ = std::min(text_.find_first_of(",]} \t\r\n/", at_), text_.size());
    }

    void object(const std::string& pointer) {
        ++at_;
        for (skip(); peek() == '"'; skip()) {
            const Place key_place = place();
            const auto key = nlohmann::json::parse(string()).get<std::string>();
            skip();
            ++at_; // the colon
            skip();
            value(child_pointer(pointer, key), key_place);
            skip();
            if (peek() == ',')
                ++at_;
        }
        ++at_;
    }

    void array(const std::string& pointer) {
        ++at_;
        std::size_t index = 0;
        for (skip(); peek() != ']' && peek() != '\0'; skip()) {
            value(pointer + "/" + std::to_string(index++), place());
            skip();
            if (peek() == ',')
                ++at_;
        }
        ++at_;
    }

    std::string_view text_;
    std::size_t at_ = 0, counted_ = 0;
    Place current_;
    Places places_;
};

} // namespace

Place place_of(std::string_view text, std::size_t offset) {
    Place place;
    const std::size_t bom = text.starts_with("\xEF\xBB\xBF") ? 3 : 0;
    for (std::size_t i = bom; i < offset && i < text.size(); ++i) {
        if (text[i] == '\n')
            ++place.line, place.column = 1;
        else if ((static_cast<unsigned char>(text[i]) & 0xC0) != 0x80)
            ++place.column;
    }
    return place;
}

Places locate(std::string_view text) {
    return Walker(text).walk();
}

std::string child_pointer(const std::string& pointer, std::string_view key) {
    std::string result = pointer + '/';
    for (const char c : key) {
        if (c == '~')
            result += "~0";
        else if (c == '/')
            result += "~1";
        else
            result += c;
    }
    return result;
}

} // namespace talus::cli
