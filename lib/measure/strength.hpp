// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "measure/failure_envelope.hpp"
#include "measure/triaxial_curve.hpp"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace talus::measure {

/// One test of a set: computed, or measured in a laboratory.
struct TriaxialTest {
    std::string source; ///< file, for messages and the key of pictures
    bool laboratory = false;
    TestPeak peak;
    TriaxialCurve curve;                  ///< empty where only the peak is known
    std::optional<TriaxialResult> result; ///< none where only the peak is known
};

/// Reads the peak off a curve.
/// @throws Error as analyse_triaxial, with the source before it
TriaxialTest test_of(std::string source, bool laboratory, TriaxialCurve curve,
                     const TriaxialOptions& options);

/// "source: what was achieved, what was asked for, by how much they differ"; empty where the test held its
/// confining stress or none was asked for.
std::string not_held(const TriaxialTest& test, const TriaxialOptions& options);

/// The envelopes of a set of tests.
struct Strength {
    FailureEnvelope peak;                      ///< of the main tests
    std::optional<FailureEnvelope> residual;   ///< of their stresses at 11 to 12 % strain
    std::optional<FailureEnvelope> laboratory; ///< of the laboratory's peaks
    std::string no_residual, no_laboratory;    ///< why there is none
};

/// Computed tests (and peaks without a curve) are the main ones, the laboratory's get an envelope of their
/// own; without computed ones the laboratory's are the main ones, and `laboratory` stays empty.
/// The residual envelope needs a residual stress of every main test.
/// @throws Error as fit_failure_envelope, for the main tests' peaks only
Strength fit_strength(std::span<const TriaxialTest> tests, const EnvelopeOptions& options = {});

/// Is it fitted by `Strength::peak`?
bool is_main(const TriaxialTest& test, std::span<const TriaxialTest> tests);

/// CSV: the envelopes in lines that begin with '#', a header line, one line per test (SI, angles in degrees),
/// empty fields where there is no value. Its peaks can be read again with parse_peaks.
std::string tests_table(std::span<const TriaxialTest> tests, const Strength& strength);

} // namespace talus::measure
