// SPDX-License-Identifier: GPL-3.0-or-later
// Inside cli/ only: the words of the command line.
#pragma once
#include "cli/settings.hpp"
#include <memory>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace talus::cli {

struct Common;
struct ToolInfo;

/// One value given on the command line, in its order.
struct Assignment {
    std::string key, text, source;
    bool verbatim = false;
};

/// What was asked for besides the settings.
struct Request {
    std::string config;
    bool print_config = false, help = false, version = false;
    std::vector<Assignment> assignments;
};

/// An app with the common switches bound to `common` and `request`.
std::unique_ptr<CLI::App> make_app(const ToolInfo& info, Common& common, Request& request);

/// Adds a switch for every setting.
void add_settings(CLI::App& app, const Settings& settings, Request& request);

/// Parses. @returns what is wrong, one line each.
std::vector<std::string> parse(CLI::App& app, const Settings& settings, Request& request,
                               const std::vector<std::string>& words);

/// The command line as a shell would take it again.
std::string quoted_command_line(int argc, char** argv);

} // namespace talus::cli
