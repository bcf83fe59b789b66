// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "cli/signals.hpp"
#include "run_tool.hpp"
#include <CLI/CLI.hpp>
#include <csignal>
#include <fcntl.h>
#include <sys/stat.h>

using namespace talus;
using namespace talus::cli;

namespace {

TEST(Tool, help_and_version_go_to_stdout) {
    SampleTool tool;
    const Outcome help = tool.run({"--help"});
    EXPECT_EQ(help.code, 0);
    EXPECT_EQ(help.err, "");
    for (const char* word : {"Usage: sample", "--box-length", "LENGTH", "default 0.03", "--material.density",
                             "-j", "--print-config", "compress|sediment", "--no-provenance", "--dry-run"})
        EXPECT_NE(help.out.find(word), std::string::npos) << word << "\n" << help.out;
    SampleTool other;
    const Outcome version = other.run({"--version"});
    EXPECT_EQ(version.code, 0);
    for (const char* word : {"sample (talus) 1.2.3", "HDF5 1.10.8", "CLI11 2.", "nlohmann-json 3.", "fmt ",
                             "compiler: ", "C++20", "flags: ", "SIMD target: "})
        EXPECT_NE(version.out.find(word), std::string::npos) << word << "\n" << version.out;
    EXPECT_FALSE(tool.ran || other.ran);
}

TEST(Tool, words_that_are_not_utf8_do_no_harm) {
    SampleTool tool;
    tool.body = [](Tool& t) { EXPECT_EQ(t.effective_config()["title"], "\xEF\xBF\xBD"); };
    EXPECT_EQ(tool.run({"--title", "\xff"}).code, 0);
    EXPECT_TRUE(tool.ran);
    EXPECT_EQ(tool.run({"--title", "\xff", "--print-config"}).code, 0);
    EXPECT_EQ(tool.run({"--radius", "\xff"}).code, 2);
    EXPECT_EQ(tool.run({"--set", "\xff=\xff"}).code, 2);
}

TEST(Tool, usage_errors_exit_2_on_one_line) {
    const auto run = [](std::vector<std::string> words) {
        SampleTool tool;
        const Outcome outcome = tool.run(words);
        EXPECT_EQ(outcome.code, 2) << outcome.err;
        EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
        EXPECT_TRUE(outcome.err.starts_with("sample: error: ")) << outcome.err;
        EXPECT_EQ(outcome.out, "");
        EXPECT_FALSE(tool.ran);
        return outcome.err;
    };
    EXPECT_EQ(run({"--raduis", "3"}),
              "sample: error: found unknown switch --raduis, did you mean --radius?\n");
    EXPECT_EQ(run({"--material.densty=3"}),
              "sample: error: found unknown switch --material.densty, did you mean --material.density?\n");
    EXPECT_EQ(run({"--quux"}), "sample: error: found unknown switch --quux, see --help\n");
    EXPECT_EQ(run({"-Z"}), "sample: error: found unknown switch -Z, see --help\n");
    run({"--radius"}); // no value
    run({"-o"});
    run({"a", "b", "c"});
    SampleTool two;
    EXPECT_EQ(std::ranges::count(two.run({"--raduis", "3", "--quux"}).err, '\n'), 2) << "all at once";
}

TEST(Tool, inputs_are_counted_and_output_is_asked_for) {
    const Scratch scratch;
    const std::string input = scratch.write("in.h5", "x");
    SampleTool none, enough, dry;
    none.info.min_inputs = 1;
    EXPECT_EQ(none.run({}).err, "sample: error: found 0 input files, expected at least 1, see --help\n");
    enough.info.needs_output = true;
    EXPECT_EQ(enough.run({input}).code, 2);
    EXPECT_EQ(enough.run({input}).err, "sample: error: no output file: give one with -o FILE\n");
    dry.info.needs_output = true;
    dry.body = [&](Tool& t) {
        EXPECT_TRUE(t.common().dry_run);
        EXPECT_EQ(t.common().inputs, std::vector<std::string>{input});
        EXPECT_GE(t.common().threads, 1);
    };
    EXPECT_EQ(dry.run({input, "-n"}).code, 0);
    EXPECT_TRUE(dry.ran);
}

TEST(Tool, common_switches) {
    const Scratch scratch;
    const std::string a = scratch.write("a", "x"), b = scratch.write("b", "x");
    SampleTool tool;
    std::string extra;
    tool.body = [&](Tool& t) {
        const Common& c = t.common();
        EXPECT_EQ(c.inputs, (std::vector<std::string>{a, b}));
        EXPECT_EQ(c.output, scratch / "out");
        EXPECT_EQ(c.threads, 3);
        EXPECT_EQ(c.seed, 42u);
        EXPECT_EQ(c.format, "json");
        EXPECT_EQ(c.progress, "none");
        EXPECT_EQ(c.verbosity, 2);
        EXPECT_FALSE(c.provenance);
        EXPECT_TRUE(t.provenance_after({{}}).empty());
        t.note("said with -v");
        t.warn("careful");
    };
    const Outcome outcome = tool.run({a, "-o", scratch / "out", b, "-j3", "--seed", "42", "--format=json",
                                      "--progress", "none", "-vv", "--no-provenance"});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_TRUE(tool.ran);
    EXPECT_EQ(outcome.err, "sample: said with -v\nsample: warning: careful\n");
    SampleTool quiet;
    quiet.body = [](Tool& t) { t.warn("careful"), t.note("more"); };
    EXPECT_EQ(quiet.run({"-q"}).err, "");
}

TEST(Tool, missing_files_exit_4) {
    const Scratch scratch;
    SampleTool config, input, directory;
    const Outcome a = config.run({"-c", scratch / "none.json"});
    EXPECT_EQ(a.code, 4);
    EXPECT_EQ(a.err, "sample: error: " + (scratch / "none.json") +
                         ": configuration file cannot be read: No such file or directory\n");
    EXPECT_EQ(config.run({"-c", scratch / ""}).code, 4) << "a directory";
    EXPECT_EQ(input.run({scratch / "none.h5"}).code, 4);
    EXPECT_EQ(directory.run({scratch / ""}).code, 4);
    EXPECT_FALSE(config.ran || input.ran || directory.ran);
}

TEST(Tool, an_existing_output_is_refused) {
    const Scratch scratch;
    const std::string path = scratch.write("out.h5", "old");
    SampleTool refused, replaced, lost, device;
    const Outcome a = refused.run({"-o", path});
    EXPECT_EQ(a.code, 5);
    EXPECT_EQ(a.err, "sample: error: " + path +
                         ": output exists: give --overwrite to replace it, or another name\n");
    EXPECT_FALSE(refused.ran);
    EXPECT_EQ(replaced.run({"-o", path, "--overwrite"}).code, 0);
    EXPECT_TRUE(replaced.ran);
    EXPECT_EQ(lost.run({"-o", scratch / "no/such/out.h5"}).code, 1);
    EXPECT_EQ(device.run({"-o", "/dev/full"}).code, 5);
    EXPECT_EQ(device.run({"-o", "/dev/full", "--overwrite"}).code, 1) << "a device is never renamed over";
    EXPECT_FALSE(device.ran);
}

TEST(Tool, errors_become_exit_codes) {
    const auto run = [](const std::function<void(Tool&)>& body) {
        SampleTool tool;
        tool.body = body;
        return tool.run({});
    };
    const Outcome quality = run([](Tool&) { throw Error(ExitCode::quality_not_reached, "not\nconverged"); });
    EXPECT_EQ(quality.code, 6);
    EXPECT_EQ(quality.err, "sample: error: not converged\n");
    const Outcome stopped =
        run([](Tool&) { throw Error(ExitCode::stopped_with_checkpoint, "stopped at step 3: run me again"); });
    EXPECT_EQ(stopped.code, 75);
    EXPECT_EQ(stopped.err, "sample: stopped at step 3: run me again\n");
    EXPECT_EQ(run([](Tool&) { throw std::bad_alloc(); }).code, 1);
    EXPECT_EQ(run([](Tool&) { std::filesystem::create_directory("/none/none"); }).code, 1);
    const Outcome signal = run([](Tool&) {
        install_stop_handler();
        throw_if_stop_requested();
        raise(SIGUSR1);
        throw_if_stop_requested();
    });
    std::signal(SIGUSR1, SIG_DFL), std::signal(SIGINT, SIG_DFL), std::signal(SIGTERM, SIG_DFL);
    EXPECT_EQ(signal.code, 128 + SIGUSR1);
}

TEST(Tool, results_in_three_formats) {
    const nlohmann::json result = {{"schema", "sample"},
                                   {"n", 3},
                                   {"x", 0.25},
                                   {"list", {1, 2}},
                                   {"deep", {{"text", "a,\"b\""}, {"items", {{{"v", 1}}, {{"v", 2}}}}}},
                                   {"nothing", nullptr}};
    const auto run = [&](const std::string& format, const std::string& view) {
        SampleTool tool;
        tool.body = [&](Tool& t) { t.result(result, view); };
        const Outcome outcome = tool.run({"--format", format});
        EXPECT_EQ(outcome.code, 0);
        return outcome.out;
    };
    EXPECT_EQ(nlohmann::json::parse(run("json", "view")), result);
    EXPECT_EQ(run("csv", "view"), "key,value\ndeep.items.0.v,1\ndeep.items.1.v,2\ndeep.text,\"a,\"\"b\"\"\"\n"
                                  "list.0,1\nlist.1,2\nn,3\nnothing,\nschema,sample\nx,0.25\n");
    EXPECT_EQ(run("text", "a view"), "a view\n");
    EXPECT_NE(run("text", "").find("list:           [1, 2]\n"), std::string::npos) << run("text", "");
}

TEST(Tool, a_report_may_go_to_the_output) {
    const Scratch scratch;
    SampleTool tool;
    tool.info.result_in_output = true;
    tool.body = [](Tool& t) { t.result({{"a", 1}}); };
    const Outcome outcome = tool.run({"--format", "json", "-o", scratch / "r.json"});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_EQ(outcome.out, "");
    EXPECT_EQ(nlohmann::json::parse(slurp(scratch / "r.json")), (nlohmann::json{{"a", 1}}));
    EXPECT_EQ(scratch.files(), 1u) << "no temporary file stays";
}

TEST(Tool, provenance_tells_what_was_run) {
    const Scratch scratch;
    const std::string input = scratch.write("in.h5", "12345");
    SampleTool tool;
    tool.body = [&](Tool& t) {
        const auto chain = t.provenance_after({{.program = "before",
                                                .version = "",
                                                .command_line = "",
                                                .config = "",
                                                .seed = 0,
                                                .inputs = {}}});
        ASSERT_EQ(chain.size(), 2u);
        EXPECT_EQ(chain[1].program, "sample");
        EXPECT_EQ(chain[1].version, "1.2.3");
        EXPECT_EQ(chain[1].seed, 5u);
        EXPECT_EQ(chain[1].inputs, std::vector<std::string>{input + " (5 bytes)"});
        EXPECT_EQ(chain[1].command_line, "sample " + input + " --title 'it'\\''s' --seed=5 -j2 --radius 1cm");
        const auto config = t.effective_config();
        EXPECT_EQ(config["radius"], 0.01);
        EXPECT_EQ(config["title"], "it's");
        EXPECT_FALSE(config.contains("threads")) << "the result does not depend on it";
        EXPECT_EQ(chain[1].config, config.dump());
    };
    EXPECT_EQ(tool.run({input, "--title", "it's", "--seed=5", "-j2", "--radius", "1cm"}).code, 0);
    EXPECT_TRUE(tool.ran);
}

/// Runs the sample tool in a child whose stdout is `out` (-1: closed).
int run_with_stdout(int out, std::vector<std::string> words) {
    const pid_t child = fork();
    if (child == 0) {
        if (out >= 0)
            dup2(out, 1);
        else
            close(1);
        words.insert(words.begin(), "sample");
        std::vector<char*> argv;
        for (std::string& word : words)
            argv.push_back(word.data());
        Tool tool({.name = "sample",
                   .summary = "",
                   .version = "1",
                   .min_inputs = 0,
                   .max_inputs = 0,
                   .needs_output = false,
                   .input_help = "",
                   .epilog = "",
                   .libraries = {},
                   .result_in_output = false,
                   .simd_target = ""});
        _exit(tool.run(static_cast<int>(argv.size()), argv.data(), [&] { tool.result({{"a", 1}}); }));
    }
    int status = 0;
    waitpid(child, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

TEST(Tool, a_full_or_closed_stdout_is_an_error) {
    testing::internal::CaptureStderr();
    const int full = open("/dev/full", O_WRONLY);
    ASSERT_GE(full, 0);
    EXPECT_EQ(run_with_stdout(full, {}), 1);
    EXPECT_EQ(run_with_stdout(full, {"--help"}), 1);
    EXPECT_EQ(run_with_stdout(full, {"--print-config"}), 1);
    EXPECT_EQ(run_with_stdout(-1, {}), 1);
    int ends[2];
    ASSERT_EQ(pipe(ends), 0);
    close(ends[0]);
    EXPECT_EQ(run_with_stdout(ends[1], {}), 1) << "the reader went away";
    close(ends[1]), close(full);
    const std::string err = testing::internal::GetCapturedStderr();
    EXPECT_TRUE(
        err.starts_with("sample: error: standard output cannot be written: No space left on device\n"))
        << err;
    EXPECT_EQ(std::ranges::count(err, '\n'), 5) << err;
}

} // namespace
