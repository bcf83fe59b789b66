// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "cli/settings.hpp"
#include "io/provenance.hpp"
#include <cstdint>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

namespace CLI {
class App;
}

namespace talus::cli {

/// The switches that all tools share, after parsing.
struct Common {
    std::vector<std::string> inputs;
    std::string output;
    bool overwrite = false, dry_run = false, quiet = false, provenance = true;
    int verbosity = 0;
    int threads = 0; ///< during the body: at least 1, by default all cores the process may use
    std::string format = "text";
    std::string progress = "auto";
    std::uint64_t seed = 1;
};

struct ToolInfo {
    std::string name, summary, version;
    int min_inputs = 0, max_inputs = 0; ///< -1: no upper limit
    bool needs_output = true;           ///< -o must be given (but not for --dry-run and --print-config)
    std::string input_help, epilog;
    std::vector<std::pair<std::string, std::string>> libraries; ///< name, version for --version
    bool result_in_output =
        false;               ///< result() goes to -o where that is given (tools whose output is the report)
    std::string simd_target; ///< for --version; empty: what the compiler was allowed to use
    int default_threads = 0; ///< without -j; 0: all cores the process may use
    std::function<void()> before_error = {}; ///< called before an error is printed
};

/// The frame of a command-line tool: common switches, settings, exit codes.
class Tool {
public:
    explicit Tool(ToolInfo info);
    ~Tool();
    Tool(const Tool&) = delete;
    Tool& operator=(const Tool&) = delete;

    Settings& settings();
    Common& common();
    const Common& common() const;
    /// For options that are not configuration (paths and the like).
    CLI::App& app();

    /// Parses, answers --help, --version and --print-config, checks that inputs can be read (exit 4) and that
    /// the output may be written (exit 5), then calls body. An Error becomes one line "<tool>: error: ..." on
    /// stderr and its exit code; std::bad_alloc, file system and all other exceptions exit 1; Stopped exits
    /// 128 + signal. At the end stdout is flushed and checked: what could not be written is exit 1.
    int run(int argc, char** argv, const std::function<void()>& body);

    /// This run's record for the output file.
    io::ProvenanceRecord provenance() const;
    /// The chain to write: that of the input plus this run, or nothing with --no-provenance.
    io::Provenance provenance_after(io::Provenance chain) const;
    /// What determines the result; threads, format and progress are left out, since they do not.
    nlohmann::json effective_config() const;

    /// The result on stdout in --format: json as it is, csv as key,value with arrays flattened, text as
    /// text_view or (where that is empty) aligned lines of key and value.
    void result(const nlohmann::json& json, const std::string& text_view = "");

    /// "<tool>: warning: ..." on stderr unless --quiet.
    void warn(const std::string& line);
    /// "<tool>: ..." on stderr with -v.
    void note(const std::string& line);

private:
    struct State;
    std::unique_ptr<State> state_;
};

} // namespace talus::cli
