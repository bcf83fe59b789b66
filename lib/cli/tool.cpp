// SPDX-License-Identifier: GPL-3.0-or-later
#include "cli/tool.hpp"
#include "base/error.hpp"
#include "base/thread_team.hpp"
#include "cli/command_line.hpp"
#include "cli/document.hpp"
#include "cli/progress.hpp"
#include "cli/report.hpp"
#include "cli/signals.hpp"
#include "cli/streams.hpp"
#include "cli/version.hpp"
#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <sys/stat.h>

namespace talus::cli {

struct Tool::State {
    ToolInfo info;
    Common common;
    Settings settings;
    Request request;
    std::unique_ptr<CLI::App> app;
    std::unique_ptr<Document> document;
    std::string command_line;
    std::int64_t threads = 0, seed = 1;

    int prepare_and_run(int argc, char** argv, const std::function<void()>& body);
    void check_files();
    int usage(const std::string& message) const;
    void line(const char* kind, std::string text) const;
};

namespace {

using Json = nlohmann::ordered_json;

int number_of(ExitCode code) {
    return static_cast<int>(code);
}

void print(const std::string& text) {
    std::fwrite(text.data(), 1, text.size(), stdout);
}

} // namespace

void Tool::State::line(const char* kind, std::string text) const {
    if (std::string_view(kind) == "error: " && info.before_error)
        info.before_error();
    std::replace(text.begin(), text.end(), '\n', ' ');
    clear_progress_line();
    fmt::print(stderr, "{}: {}{}\n", info.name, kind, text);
}

int Tool::State::usage(const std::string& message) const {
    line("error: ", message);
    return number_of(ExitCode::usage);
}

/// Reads file, --set and switches; prints everything that is wrong. @returns the exit code, 0 where all is
/// well.
static int report(const std::vector<Problem>& problems) {
    int code = 0;
    for (const Problem& problem : problems) {
        fmt::print(stderr, "{}\n", problem.line);
        // A faulty file outranks a faulty switch.
        if (code != number_of(ExitCode::configuration_invalid))
            code = number_of(problem.code);
    }
    return code;
}

void Tool::State::check_files() {
    for (const std::string& input : common.inputs)
        check_input(input);
    if (!common.output.empty())
        check_output(common.output, common.overwrite);
}

int Tool::State::prepare_and_run(int argc, char** argv, const std::function<void()>& body) {
    command_line = quoted_command_line(argc, argv);
    add_settings(*app, settings, request);
    const std::vector<std::string> wrong =
        parse(*app, settings, request, std::vector<std::string>(argv + std::min(argc, 1), argv + argc));
    if (request.help) {
        print(app->help());
        return 0;
    }
    if (request.version) {
        print(version_text(info));
        return 0;
    }
    for (const std::string& message : wrong)
        line("error: ", message);
    if (!wrong.empty())
        return number_of(ExitCode::usage);

    document = std::make_unique<Document>(info.name);
    std::vector<Problem> problems;
    const auto add = [&](const std::vector<Problem>& more) {
        problems.insert(problems.end(), more.begin(), more.end());
    };
    if (!request.config.empty())
        add(document->read_file(request.config));
    for (const Assignment& a : request.assignments)
        add(document->assign(a.key, a.text, a.source, a.verbatim));
    if (document->readable())
        add(settings.load(*document));
    if (!problems.empty() && info.before_error)
        info.before_error();
    if (const int code = report(problems))
        return code;

    common.threads = threads > 0                ? static_cast<int>(threads)
                     : info.default_threads > 0 ? info.default_threads
                                                : ThreadTeam::available();
    common.seed = static_cast<std::uint64_t>(seed);
    if (request.print_config) {
        print(settings.effective().dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
        return 0;
    }
    const auto count = static_cast<int>(common.inputs.size());
    if (count < info.min_inputs)
        return usage(fmt::format("found {} input file{}, expected {}{}, see --help", count,
                                 count == 1 ? "" : "s", info.max_inputs == info.min_inputs ? "" : "at least ",
                                 info.min_inputs));
    if (info.max_inputs >= 0 && count > info.max_inputs)
        return usage(
            fmt::format("found {} inputs, the last \"{}\", expected at most {}; the output is given with -o",
                        count, common.inputs.back(), info.max_inputs));
    if (info.needs_output && common.output.empty() && !common.dry_run)
        return usage("no output file: give one with -o FILE");
    check_files();
    body();
    return 0;
}

Tool::Tool(ToolInfo info) : state_(std::make_unique<State>()) {
    State& s = *state_;
    s.info = std::move(info);
    s.app = make_app(s.info, s.common, s.request);
    s.settings.integer("threads", s.threads, "Threads; 0: all cores the process may use", 0, 4096);
    s.settings.choice("format", s.common.format, {"text", "json", "csv"}, "Results on stdout");
    s.settings.choice("progress", s.common.progress, {"auto", "bar", "json", "none"}, "Progress on stderr");
    s.settings.integer("seed", s.seed, "Seed of everything random", 0);
}

Tool::~Tool() = default;
Settings& Tool::settings() {
    return state_->settings;
}
Common& Tool::common() {
    return state_->common;
}
const Common& Tool::common() const {
    return state_->common;
}
CLI::App& Tool::app() {
    return *state_->app;
}

int Tool::run(int argc, char** argv, const std::function<void()>& body) {
    guard_standard_streams();
    std::signal(SIGXFSZ, SIG_IGN); // a file size limit is a failed write like a full disk
    std::signal(SIGPIPE, SIG_IGN); // a reader that went away is seen when stdout is checked
    const State& s = *state_;
    int code = 0;
    try {
        code = state_->prepare_and_run(argc, argv, body);
    } catch (const Error& error) {
        code = number_of(error.code());
        s.line(error.code() == ExitCode::stopped_with_checkpoint ? "" : "error: ", error.what());
    } catch (const Stopped& stopped) {
        code = 128 + stopped.signal();
        s.line("", fmt::format("stopped by signal {}, no output written", stopped.signal()));
    } catch (const std::bad_alloc&) {
        code = number_of(ExitCode::run_failed);
        s.line("error: ",
               "out of memory: use fewer particles or a larger machine (--dry-run tells the need)");
    } catch (const std::exception& error) {
        code = number_of(ExitCode::run_failed);
        s.line("error: ", error.what());
    }
    if (const std::string why = finish_stdout(); !why.empty()) {
        s.line("error: ", fmt::format("standard output cannot be written: {}", why));
        if (code == 0)
            code = number_of(ExitCode::run_failed);
    }
    return code;
}

io::ProvenanceRecord Tool::provenance() const {
    const State& s = *state_;
    io::ProvenanceRecord record;
    record.program = s.info.name;
    record.version = s.info.version;
    record.command_line = s.command_line;
    record.config = effective_config().dump();
    record.seed = s.common.seed;
    for (const std::string& input : s.common.inputs) {
        struct stat info {};
        const bool known = stat(input.c_str(), &info) == 0;
        record.inputs.push_back(known ? fmt::format("{} ({} bytes)", input, info.st_size) : input);
    }
    return record;
}

io::Provenance Tool::provenance_after(io::Provenance chain) const {
    if (!state_->common.provenance)
        return {};
    chain.push_back(provenance());
    return chain;
}

nlohmann::json Tool::effective_config() const {
    nlohmann::json config = nlohmann::json::parse(
        state_->settings.effective().dump(-1, ' ', false, Json::error_handler_t::replace));
    for (const char* key : {"threads", "format", "progress"})
        config.erase(key);
    return config;
}

void Tool::result(const nlohmann::json& json, const std::string& text_view) {
    const State& s = *state_;
    std::string text;
    if (s.common.format == "json")
        text = json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
    else if (s.common.format == "csv")
        text = as_csv(json);
    else
        text = text_view.empty() ? as_text(json) : text_view;
    if (!text.empty() && text.back() != '\n')
        text += '\n';
    if (s.info.result_in_output && !s.common.output.empty())
        write_file(s.common.output, text);
    else
        print(text);
}

void Tool::warn(const std::string& line) {
    if (!state_->common.quiet)
        state_->line("warning: ", line);
}

void Tool::note(const std::string& line) {
    if (state_->common.verbosity > 0 && !state_->common.quiet)
        state_->line("", line);
}

} // namespace talus::cli
