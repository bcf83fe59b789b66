// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/explicit_file.hpp"
#include "io/hdf_file.hpp"
#include "io/streamed_column.hpp"

#include <cstdint>
#include <string>

namespace talus::io {

/// Writes /particles/all and the contacts of an explicit model, some particles at a time.
class ExplicitColumns {
public:
    ExplicitColumns(const hdf::File& to, const ExplicitFrame& frame, ThreadTeam& team);
    ExplicitColumns(const ExplicitColumns&) = delete; // columns know their groups
    ExplicitColumns& operator=(const ExplicitColumns&) = delete;
    void add(const Grains& grains);
    /// Returns the XDMF sidecar, which shows the particles.
    std::string finish(const std::string& path);

private:
    const ExplicitFrame frame_;
    hdf::Group root_, particles_;
    std::uint64_t count_ = 0;    ///< particles so far
    std::uint64_t contacts_ = 0; ///< so far
    std::int64_t largest_partner_ = -1;
    hdf::ChunkPress press_;
    StreamedColumn<double> position_, radius_;
    StreamedColumn<std::uint8_t> species_, release_, material_;
    StreamedColumn<std::int64_t> pair_;
    StreamedColumn<std::int8_t> image_;
    StreamedColumn<double> overlap_;
};

} // namespace talus::io
