// SPDX-License-Identifier: GPL-3.0-or-later
#include "terrain/raster.hpp"

#include "base/error.hpp"
#include "terrain/gdal_session.hpp"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <gdal_priv.h>
#include <limits>
#include <memory>
#include <ogr_spatialref.h>
#include <unistd.h>

namespace talus::terrain {

namespace fs = std::filesystem;

namespace {

constexpr double no_data_value = -9999;

struct DatasetCloser {
    void operator()(GDALDataset* dataset) const { GDALClose(dataset); }
};
using Dataset = std::unique_ptr<GDALDataset, DatasetCloser>;

[[noreturn]] void refuse(const std::string& path, const std::string& what) {
    throw Error(ExitCode::input_invalid, fmt::format("{}: {}", path, what));
}

std::string to_wkt(const OGRSpatialReference& system) {
    char* text = nullptr;
    const char* const options[] = {"FORMAT=WKT2_2019", nullptr};
    if (system.exportToWkt(&text, options) != OGRERR_NONE || !text) {
        CPLFree(text);
        return {};
    }
    std::string wkt = text;
    CPLFree(text);
    return wkt;
}

/// The system's WKT; ESRI's dialect of a .prj is matched to the authority's definition where that is certain.
std::string coordinate_system_of(const GDALDataset& dataset, const std::string& path) {
    const OGRSpatialReference* stated = dataset.GetSpatialRef();
    if (!stated)
        return {};
    if (stated->IsGeographic())
        refuse(path,
               fmt::format("coordinate system {} is in degrees, projected metres are needed; reproject with "
                           "'gdalwarp -t_srs EPSG:<UTM zone> -r bilinear {} out.tif'",
                           stated->GetName() ? stated->GetName() : "(unnamed)", path));
    const double unit = stated->GetLinearUnits();
    if (std::abs(unit - 1) > 1e-9)
        refuse(path,
               fmt::format("coordinate system's unit is {} m, metres are needed; reproject with 'gdalwarp "
                           "-t_srs EPSG:<UTM zone> -r bilinear {} out.tif'",
                           unit, path));
    std::unique_ptr<OGRSpatialReference> system(stated->Clone());
    if (!system->GetAuthorityCode(nullptr)) {
        int found = 0;
        int* confidence = nullptr;
        OGRSpatialReferenceH* matches = system->FindMatches(nullptr, &found, &confidence);
        if (found == 1 && confidence[0] >= 90)
            system.reset(static_cast<OGRSpatialReference*>(matches[0])->Clone());
        OSRFreeSRSArray(matches);
        CPLFree(confidence);
    }
    return to_wkt(*system);
}

/// GDAL takes a word that is no number for zero, and missing cells too: count and parse them.
void check_ascii_cells(const std::string& path, int width, int height) {
    std::ifstream file(path);
    std::string line;
    std::uint64_t cells = 0;
    const std::uint64_t expected = static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
    for (std::size_t number = 1; std::getline(file, line); ++number) {
        const char* at = line.data();
        const char* const end = at + line.size();
        bool header = false;
        while (!header) {
            at = std::find_if(at, end, [](char c) { return c != ' ' && c != '\t' && c != '\r'; });
            if (at == end)
                break;
            if (*at == '+')
                ++at;
            double value = 0;
            const auto [rest, error] = std::from_chars(at, end, value);
            const bool ends = rest == end || *rest == ' ' || *rest == '\t' || *rest == '\r';
            if (error == std::errc::result_out_of_range || (error == std::errc{} && ends)) {
                at = rest;
                ++cells;
                continue;
            }
            header = cells == 0 && std::isalpha(static_cast<unsigned char>(*at));
            if (!header)
                refuse(path, fmt::format("line {}: '{}' is not a number; repair the grid or write it again",
                                         number, std::string(at, std::min(end, at + 20))));
        }
    }
    if (cells != expected)
        refuse(path, fmt::format("{} cells found, {} x {} = {} expected; the file is truncated or damaged",
                                 cells, width, height, expected));
}

void refuse_unstated_degrees(const Raster& raster, const std::string& path) {
    const bool within_degrees =
        raster.lower_x >= -360 && raster.upper_x() <= 360 && raster.lower_y >= -90 && raster.upper_y() <= 90;
    if (!raster.coordinate_system.empty() || !within_degrees)
        return;
    double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
    for (std::size_t k = 0; k < raster.size(); ++k)
        if (raster.valid[k]) {
            lowest = std::min(lowest, raster.values[k]);
            highest = std::max(highest, raster.values[k]);
        }
    const double extent = std::max(raster.upper_x() - raster.lower_x, raster.upper_y() - raster.lower_y);
    if (highest - lowest > 100 * extent)
        refuse(path,
               fmt::format("no coordinate system is stated, and values that vary by {:.6g} over {:.6g} map "
                           "units look like geographic degrees; reproject with 'gdalwarp -s_srs EPSG:4326 "
                           "-t_srs EPSG:<UTM zone> -r bilinear {} out.tif', or state the system in a .prj",
                           highest - lowest, extent, path));
}

} // namespace

std::size_t Raster::valid_count() const {
    return static_cast<std::size_t>(std::count(valid.begin(), valid.end(), std::uint8_t{1}));
}

bool Raster::same_grid(const Raster& other) const {
    const auto near = [this](double a, double b) {
        return std::abs(a - b) <= 1e-6 * std::min(cell_x, cell_y);
    };
    return width == other.width && height == other.height && near(lower_x, other.lower_x) &&
           near(lower_y, other.lower_y) && near(upper_x(), other.upper_x()) &&
           near(upper_y(), other.upper_y()) && compatible_systems(coordinate_system, other.coordinate_system);
}

Raster make_raster(const Raster& like, double value) {
    Raster raster = like;
    raster.values.assign(like.size(), value);
    raster.valid.assign(like.size(), 1);
    raster.name.clear();
    return raster;
}

Raster read_raster(const std::string& path) {
    start_gdal();
    if (!fs::exists(path))
        refuse(path, "no such file; give a GeoTIFF or an ESRI ASCII grid");
    Dataset dataset(GDALDataset::Open(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY));
    if (!dataset)
        refuse(path, fmt::format("not a raster that GDAL reads ({}); give a GeoTIFF or an ESRI ASCII grid",
                                 last_gdal_message()));
    const std::string driver = dataset->GetDriverName();
    if (driver == "AAIGrid") { // reads single precision, or integers, unless told
        const char* const options[] = {"DATATYPE=Float64", nullptr};
        dataset.reset();
        dataset.reset(GDALDataset::Open(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY, nullptr, options));
        if (!dataset)
            refuse(path, fmt::format("cannot be read ({})", last_gdal_message()));
        check_ascii_cells(path, dataset->GetRasterXSize(), dataset->GetRasterYSize());
    }
    if (dataset->GetRasterCount() != 1)
        refuse(path,
               fmt::format("{} bands, a raster of elevations has one; take one out with 'gdal_translate -b 1 "
                           "{} out.tif'",
                           dataset->GetRasterCount(), path));
    double transform[6];
    if (dataset->GetGeoTransform(transform) != CE_None)
        refuse(path, "has no georeference; state it with 'gdal_translate -a_ullr' or a world file");
    if (transform[2] != 0 || transform[4] != 0 || transform[1] <= 0 || transform[5] == 0)
        refuse(path,
               fmt::format("rotated or mirrored georeference; make it north-up with 'gdalwarp {} out.tif'",
                           path));

    Raster raster;
    raster.name = path;
    raster.width = static_cast<std::size_t>(dataset->GetRasterXSize());
    raster.height = static_cast<std::size_t>(dataset->GetRasterYSize());
    raster.cell_x = transform[1];
    raster.cell_y = std::abs(transform[5]);
    raster.lower_x = transform[0];
    const bool north_up = transform[5] < 0;
    raster.lower_y =
        north_up ? transform[3] + static_cast<double>(raster.height) * transform[5] : transform[3];
    raster.coordinate_system = coordinate_system_of(*dataset, path);
    raster.values.resize(raster.size());
    raster.valid.assign(raster.size(), 1);

    GDALRasterBand* band = dataset->GetRasterBand(1);
    for (std::size_t line = 0; line < raster.height; ++line) {
        const std::size_t row = north_up ? raster.height - 1 - line : line;
        if (band->RasterIO(GF_Read, 0, static_cast<int>(line), static_cast<int>(raster.width), 1,
                           raster.values.data() + raster.index(0, row), static_cast<int>(raster.width), 1,
                           GDT_Float64, 0, 0, nullptr) != CE_None)
            refuse(path, fmt::format("line {}: cannot be read, the file is damaged ({})", line + 1,
                                     last_gdal_message()));
    }
    int has_no_data = 0;
    const double no_data = band->GetNoDataValue(&has_no_data);
    // A float32 file's no-data value need not be representable: compare as the file stores it.
    const bool single = band->GetRasterDataType() == GDT_Float32;
    const auto is_no_data = [&](double value) {
        if (!has_no_data)
            return false;
        if (std::isnan(no_data))
            return std::isnan(value);
        return value == no_data || (single && static_cast<float>(value) == static_cast<float>(no_data));
    };
    for (std::size_t row = 0; row < raster.height; ++row)
        for (std::size_t column = 0; column < raster.width; ++column) {
            double& value = raster.values[raster.index(column, row)];
            if (is_no_data(value)) {
                raster.valid[raster.index(column, row)] = 0;
                value = 0;
            } else if (!std::isfinite(value)) {
                refuse(
                    path,
                    fmt::format("line {}, column {}: {} is not an elevation; mark such cells as no-data with "
                                "'gdal_translate -a_nodata nan {} out.tif'",
                                north_up ? raster.height - row : row + 1, column + 1, value, path));
            }
        }
    if (raster.valid_count() == 0)
        refuse(path, "no cell has data; check the no-data value or the extent it was cut to");
    refuse_unstated_degrees(raster, path);
    return raster;
}

namespace {

Dataset in_memory(const Raster& raster) {
    GDALDriver* memory = GetGDALDriverManager()->GetDriverByName("MEM");
    Dataset dataset(memory->Create("", static_cast<int>(raster.width), static_cast<int>(raster.height), 1,
                                   GDT_Float64, nullptr));
    if (!dataset)
        throw Error(ExitCode::run_failed, fmt::format("raster in memory: {}", last_gdal_message()));
    double transform[6] = {raster.lower_x, raster.cell_x, 0, raster.upper_y(), 0, -raster.cell_y};
    dataset->SetGeoTransform(transform);
    if (!raster.coordinate_system.empty())
        dataset->SetProjection(raster.coordinate_system.c_str());
    GDALRasterBand* band = dataset->GetRasterBand(1);
    band->SetNoDataValue(no_data_value);
    std::vector<double> line(raster.width);
    for (std::size_t row = 0; row < raster.height; ++row) {
        for (std::size_t column = 0; column < raster.width; ++column) {
            const std::size_t k = raster.index(column, row);
            line[column] = raster.valid[k] ? raster.values[k] : no_data_value;
        }
        if (band->RasterIO(GF_Write, 0, static_cast<int>(raster.height - 1 - row),
                           static_cast<int>(raster.width), 1, line.data(), static_cast<int>(raster.width), 1,
                           GDT_Float64, 0, 0, nullptr) != CE_None)
            throw Error(ExitCode::run_failed, fmt::format("raster in memory: {}", last_gdal_message()));
    }
    return dataset;
}

/// A directory beside the output that vanishes with this object: what is half written is never seen.
class ScratchDirectory {
public:
    explicit ScratchDirectory(const fs::path& beside)
        : path_(beside.parent_path() / fmt::format(".{}.{}.tmp", beside.filename().string(), getpid())) {
        std::error_code error;
        if (!fs::create_directory(path_, error))
            throw Error(ExitCode::run_failed,
                        fmt::format("{}: cannot write into its directory ({}); choose another output",
                                    beside.string(), error ? error.message() : "scratch name taken"));
    }
    ~ScratchDirectory() {
        std::error_code ignored;
        fs::remove_all(path_, ignored);
    }
    ScratchDirectory(const ScratchDirectory&) = delete;
    ScratchDirectory& operator=(const ScratchDirectory&) = delete;
    const fs::path& path() const { return path_; }

private:
    fs::path path_;
};

} // namespace

void write_raster(const std::string& path, const Raster& raster, bool overwrite) {
    start_gdal();
    const fs::path target = fs::absolute(path);
    const std::string extension = target.extension().string();
    const bool ascii = extension == ".asc";
    if (!ascii && extension != ".tif" && extension != ".tiff")
        throw Error(ExitCode::usage, fmt::format("{}: unknown raster extension; name it .tif or .asc", path));
    if (fs::exists(target) && (!overwrite || !fs::is_regular_file(target)))
        throw Error(ExitCode::output_exists, fmt::format("{}: exists; remove it or give --overwrite", path));
    for (std::size_t k = 0; k < raster.size(); ++k)
        if (raster.valid[k] && !std::isfinite(raster.values[k]))
            throw Error(ExitCode::run_failed,
                        fmt::format("{}: row {}, column {} from the south-west: value is not finite", path,
                                    k / raster.width, k % raster.width));

    const ScratchDirectory scratch(target);
    const fs::path inner = scratch.path() / target.filename();
    GDALDriver* driver = GetGDALDriverManager()->GetDriverByName(ascii ? "AAIGrid" : "GTiff");
    const char* const ascii_options[] = {"SIGNIFICANT_DIGITS=15", nullptr};
    const char* const tiff_options[] = {"COMPRESS=DEFLATE", "PREDICTOR=3", nullptr};
    {
        Dataset source = in_memory(raster);
        CPLErrorReset();
        Dataset copy(driver->CreateCopy(inner.c_str(), source.get(), FALSE,
                                        const_cast<char**>(ascii ? ascii_options : tiff_options), nullptr,
                                        nullptr));
        if (copy)
            copy->FlushCache(true);
        if (!copy || CPLGetLastErrorType() >= CE_Failure)
            throw Error(ExitCode::run_failed,
                        fmt::format("{}: cannot be written ({})", path, last_gdal_message()));
    }
    if (CPLGetLastErrorType() >= CE_Failure)
        throw Error(ExitCode::run_failed,
                    fmt::format("{}: cannot be written ({})", path, last_gdal_message()));
    // Side files first: when the raster itself appears, it is complete.
    for (const auto& entry : fs::directory_iterator(scratch.path()))
        if (entry.path().filename() != target.filename() && entry.path().extension() == ".prj")
            fs::rename(entry.path(), target.parent_path() / entry.path().filename());
    fs::rename(inner, target);
}

Raster resample(const Raster& source, const Raster& like) {
    if (!compatible_systems(source.coordinate_system, like.coordinate_system))
        refuse(source.name, fmt::format("is in {}, {} is in {}; reproject one with 'gdalwarp -t_srs'",
                                        system_name(source.coordinate_system), like.name,
                                        system_name(like.coordinate_system)));
    Raster result = make_raster(like);
    result.name = source.name;
    std::size_t met = 0;
    for (std::size_t row = 0; row < like.height; ++row)
        for (std::size_t column = 0; column < like.width; ++column) {
            const double u = (like.centre_x(column) - source.centre_x(0)) / source.cell_x;
            const double v = (like.centre_y(row) - source.centre_y(0)) / source.cell_y;
            const std::size_t k = result.index(column, row);
            result.valid[k] = 0;
            constexpr double slack = 1e-9; // a centre on the hull's edge is inside
            const double last_u = static_cast<double>(source.width - 1),
                         last_v = static_cast<double>(source.height - 1);
            if (u < -slack || v < -slack || u > last_u + slack || v > last_v + slack)
                continue;
            const auto i = static_cast<std::size_t>(std::clamp(std::floor(u), 0.0, last_u));
            const auto j = static_cast<std::size_t>(std::clamp(std::floor(v), 0.0, last_v));
            const std::size_t i1 = std::min(i + 1, source.width - 1), j1 = std::min(j + 1, source.height - 1);
            double s = std::clamp(u - static_cast<double>(i), 0.0, 1.0);
            double t = std::clamp(v - static_cast<double>(j), 0.0, 1.0);
            s = s < slack ? 0 : (s > 1 - slack ? 1 : s); // a coinciding centre takes its cell alone
            t = t < slack ? 0 : (t > 1 - slack ? 1 : t);
            const std::size_t corner[4] = {source.index(i, j), source.index(i1, j), source.index(i, j1),
                                           source.index(i1, j1)};
            const double weight[4] = {(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t};
            bool complete = true;
            double value = 0;
            for (int c = 0; c < 4; ++c) {
                if (weight[c] > 0 && !source.valid[corner[c]])
                    complete = false;
                if (weight[c] > 0)
                    value += weight[c] * source.values[corner[c]];
            }
            if (complete) {
                result.values[k] = value;
                result.valid[k] = 1;
                ++met;
            }
        }
    if (met == 0)
        refuse(source.name,
               fmt::format("has no data in common with {}; check the extents of the two", like.name));
    return result;
}

bool compatible_systems(const std::string& wkt_a, const std::string& wkt_b) {
    if (wkt_a.empty() || wkt_b.empty() || wkt_a == wkt_b)
        return true;
    OGRSpatialReference a, b;
    if (a.importFromWkt(wkt_a.c_str()) != OGRERR_NONE || b.importFromWkt(wkt_b.c_str()) != OGRERR_NONE)
        return false;
    const char* const options[] = {"IGNORE_DATA_AXIS_TO_SRS_AXIS_MAPPING=YES", "CRITERION=EQUIVALENT",
                                   nullptr};
    return a.IsSame(&b, options);
}

std::string gdal_version() {
    return GDAL_RELEASE_NAME;
}

} // namespace talus::terrain
