// SPDX-License-Identifier: GPL-3.0-or-later
#include "cli/command_line.hpp"
#include "cli/nearest.hpp"
#include "cli/tool.hpp"
#include <CLI/CLI.hpp>
#include <algorithm>
#include <fmt/format.h>

namespace talus::cli {
namespace {

class HelpFormat : public CLI::Formatter {
public:
    explicit HelpFormat(const ToolInfo& info) : info_(info) { column_width(40); }

    std::string make_usage(const CLI::App*, std::string) const override {
        std::string inputs;
        if (info_.max_inputs != 0) {
            inputs = info_.max_inputs == 1 ? "INPUT" : "INPUT...";
            inputs = info_.min_inputs == 0 ? " [" + inputs + "]" : " " + inputs;
        }
        return fmt::format("Usage: {} [options]{} {}\n", info_.name, inputs,
                           info_.needs_output ? "-o OUTPUT" : "[-o OUTPUT]");
    }

private:
    ToolInfo info_;
};

/// The name of a long switch, "--box-length" of "--box_length=3"; empty for other words.
std::string long_name(const std::string& word) {
    if (!word.starts_with("--") || word.size() < 3)
        return {};
    std::string name = word.substr(0, word.find('='));
    std::replace(name.begin(), name.end(), '_', '-');
    return name;
}

/// The dotted key of a switch that names an element of an array of objects ("--walls.0.velocity"), else "".
std::string element_key(const std::string& name, const std::vector<Settings::Key>& keys) {
    std::string key = name.substr(2);
    std::replace(key.begin(), key.end(), '-', '_');
    for (const Settings::Key& known : keys)
        if (known.is_objects && key.size() > known.key.size() + 1 && key.starts_with(known.key + '.') &&
            key[known.key.size() + 1] >= '0' && key[known.key.size() + 1] <= '9')
            return key;
    return {};
}

std::string dashed(std::string key) {
    std::replace(key.begin(), key.end(), '_', '-');
    return key;
}

std::string default_note(const Settings::Key& key) {
    return key.default_text.empty() ? std::string() : fmt::format(" (default {})", key.default_text);
}

/// Brings the words into the form that CLI11 takes: dashes in names, settings with a value of their own kind
/// (elements of arrays, flags) as --set.
std::vector<std::string> rewritten(const std::vector<std::string>& words,
                                   const std::vector<Settings::Key>& keys) {
    std::vector<std::string> arguments;
    for (std::size_t i = 0; i < words.size(); ++i) {
        const std::string& word = words[i];
        if (word == "--") {
            arguments.insert(arguments.end(), words.begin() + static_cast<std::ptrdiff_t>(i), words.end());
            break;
        }
        const std::string name = long_name(word);
        if (name.empty()) {
            arguments.push_back(word);
            continue;
        }
        const bool has_value = word.find('=') != std::string::npos;
        std::string value = has_value ? word.substr(word.find('=') + 1) : std::string();
        const std::string element = element_key(name, keys);
        const auto flag = std::find_if(keys.begin(), keys.end(), [&](const Settings::Key& key) {
            return key.is_flag && name == "--" + dashed(key.key);
        });
        if (!element.empty()) {
            if (!has_value && i + 1 < words.size())
                value = words[++i];
            arguments.insert(arguments.end(), {"--set", element + '=' + value});
        } else if (has_value && flag != keys.end()) {
            arguments.insert(arguments.end(), {"--set", flag->key + '=' + value});
        } else if (has_value && value.empty()) {
            arguments.insert(arguments.end(), {name, ""}); // CLI11 would take the next word as the value
        } else {
            arguments.push_back(has_value ? name + '=' + value : name);
        }
    }
    return arguments;
}

} // namespace

std::unique_ptr<CLI::App> make_app(const ToolInfo& info, Common& common, Request& request) {
    auto app = std::make_unique<CLI::App>(info.summary, info.name);
    app->formatter(std::make_shared<HelpFormat>(info));
    app->footer(info.epilog);
    app->set_help_flag();
    app->allow_extras();
    if (info.max_inputs != 0)
        app->add_option("INPUT", common.inputs, info.input_help)->type_name("");
    app->add_flag("-h,--help", request.help, "This help");
    app->add_flag("--version", request.version, "Version, libraries, compiler, flags, SIMD target");
    app->add_option("-o,--output", common.output, "Output file; complete or absent")->type_name("FILE");
    app->add_flag("--overwrite", common.overwrite, "Replace the output where it exists");
    app->add_option("-c,--config", request.config,
                    "JSON file with settings; // comments allowed; switches win")
        ->type_name("FILE");
    app->add_option(
           "--set",
           [&request](const CLI::results_t& words) {
               const std::string& word = words.back();
               const auto equals = word.find('=');
               if (equals == std::string::npos || equals == 0)
                   throw CLI::ValidationError("--set", fmt::format("found {}, expected key=value", word));
               std::string key = word.substr(0, equals);
               std::replace(key.begin(), key.end(), '-', '_');
               request.assignments.push_back({key, word.substr(equals + 1), "--set " + key});
               return true;
           },
           "Set one value, key a.b.c as in the JSON file; null takes it away. Of switches and --set the last "
           "wins")
        ->type_name("KEY=VALUE")
        ->trigger_on_parse();
    app->add_flag("--print-config", request.print_config,
                  "Print the effective configuration as JSON and exit");
    app->add_flag("-n,--dry-run", common.dry_run,
                  "Check configuration and inputs, print the cost, do nothing");
    app->add_flag("-q,--quiet", common.quiet, "Errors only");
    app->add_flag("-v,--verbose", common.verbosity, "Say more; twice for still more");
    app->add_flag_callback(
        "--no-provenance", [&common] { common.provenance = false; },
        "Leave the provenance chain out, so that the output depends on the input alone");
    return app;
}

void add_settings(CLI::App& app, const Settings& settings, Request& request) {
    for (const Settings::Key& key : settings.keys()) {
        const std::string name = "--" + dashed(key.key);
        const auto dot = key.key.find('.');
        const std::string group =
            dot == std::string::npos ? "Settings" : fmt::format("Settings of {}", key.key.substr(0, dot));
        const bool common =
            key.key == "threads" || key.key == "format" || key.key == "progress" || key.key == "seed";
        const std::string names = key.key == "threads" ? "-j," + name : name;
        const bool verbatim = key.type == "TEXT";
        CLI::Option* option = nullptr;
        if (key.is_flag) {
            option = app.add_flag_function(
                names,
                [&request, key = key.key, name](std::int64_t count) {
                    request.assignments.push_back({key, count > 0 ? "true" : "false", name});
                },
                key.help + default_note(key));
        } else {
            option = app.add_option(
                            names,
                            [&request, key = key.key, name, verbatim](const CLI::results_t& words) {
                                request.assignments.push_back({key, words.back(), name, verbatim});
                                return true;
                            },
                            key.help + default_note(key))
                         ->type_name(key.type);
        }
        option->trigger_on_parse()->group(common ? "Options" : group);
    }
}

std::vector<std::string> parse(CLI::App& app, const Settings& settings, Request& request,
                               const std::vector<std::string>& words) {
    std::vector<std::string> arguments = rewritten(words, settings.keys());
    std::reverse(arguments.begin(), arguments.end());
    try {
        app.parse(std::move(arguments));
    } catch (const CLI::ParseError& error) {
        std::string line = error.what();
        std::replace(line.begin(), line.end(), '\n', ' ');
        return {line};
    } catch (const std::invalid_argument&) { // CLI11 of a flag's value, --overwrite=perhaps
        return {"found a value that a switch does not take, see --help"};
    }
    if (request.help || request.version)
        return {};
    std::vector<std::string> names;
    for (const CLI::Option* option : app.get_options())
        for (const std::string& name : option->get_lnames())
            names.push_back(name);
    std::vector<std::string> problems;
    for (const std::string& word : app.remaining()) {
        if (word.size() < 2 || word[0] != '-') {
            // The value of an unknown switch lands among the inputs; it is not worth a line of its own.
            if (problems.empty() && word != "--")
                problems.push_back(fmt::format("found \"{}\", expected no further argument", word));
            continue;
        }
        const std::string name = word.starts_with("--") ? long_name(word) : word;
        const std::string near = word.starts_with("--") ? nearest(name.substr(2), names) : std::string();
        problems.push_back(near.empty()
                               ? fmt::format("found unknown switch {}, see --help", name)
                               : fmt::format("found unknown switch {}, did you mean --{}?", name, near));
    }
    return problems;
}

std::string quoted_command_line(int argc, char** argv) {
    std::string line;
    for (int k = 0; k < argc; ++k) {
        const std::string word = argv[k];
        const bool plain =
            !word.empty() &&
            word.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                                   "@%+=:,./_-") == std::string::npos;
        if (k)
            line += ' ';
        if (plain) {
            line += word;
            continue;
        }
        line += '\'';
        for (const char c : word)
            line += c == '\'' ? std::string("'\\''") : std::string(1, c);
        line += '\'';
    }
    return line;
}

} // namespace talus::cli
