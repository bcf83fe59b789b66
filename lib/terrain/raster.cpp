// SPDX-License-Identifier: GPL-3.0-or-later
#include "terrain/raster.hpp"

#include "base/error.hpp"
#include "terrain/gdal_session.hpp"
#include "terrain/outline.hpp"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <gdal_alg.h>
#include <gdal_priv.h>
#include <limits>
#include <memory>
#include <ogr_spatialref.h>
#include <unistd.h>

namespace talus::terrain {

namespace fs = std::filesystem;

namespace {

constexpr double no_data_value = -9999;
constexpr int finest_reprojection = 4;        // new cells to a cell's edge
constexpr double largest_reprojection = 16e6; // cells, where they are finer than the source's

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
    std::string unit = band->GetUnitType();
    std::transform(unit.begin(), unit.end(), unit.begin(),
                   [](char c) { return static_cast<char>(std::tolower(static_cast<unsigned char>(c))); });
    if (unit.starts_with("f") || unit.find("foot") != std::string::npos)
        refuse(path, fmt::format(
                         "elevations are in feet ('{}'), metres are needed; convert with 'gdal_calc.py -A {} "
                         "--calc=A*0.3048 --outfile=out.tif'",
                         band->GetUnitType(), path));
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

std::optional<double> interpolate(const Raster& raster, double x, double y) {
    constexpr double slack = 1e-9; // of a cell: a centre on the hull's edge is inside
    const double u = (x - raster.centre_x(0)) / raster.cell_x, v = (y - raster.centre_y(0)) / raster.cell_y;
    const double last_u = static_cast<double>(raster.width - 1),
                 last_v = static_cast<double>(raster.height - 1);
    if (!(u >= -slack && v >= -slack && u <= last_u + slack && v <= last_v + slack))
        return std::nullopt;
    const auto i = static_cast<std::size_t>(std::clamp(std::floor(u), 0.0, last_u));
    const auto j = static_cast<std::size_t>(std::clamp(std::floor(v), 0.0, last_v));
    const std::size_t i1 = std::min(i + 1, raster.width - 1), j1 = std::min(j + 1, raster.height - 1);
    double s = std::clamp(u - static_cast<double>(i), 0.0, 1.0);
    double t = std::clamp(v - static_cast<double>(j), 0.0, 1.0);
    s = s < slack ? 0 : (s > 1 - slack ? 1 : s); // a coinciding centre takes its cell alone
    t = t < slack ? 0 : (t > 1 - slack ? 1 : t);
    const std::size_t corner[4] = {raster.index(i, j), raster.index(i1, j), raster.index(i, j1),
                                   raster.index(i1, j1)};
    const double weight[4] = {(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t};
    double value = 0;
    for (int c = 0; c < 4; ++c) {
        if (weight[c] > 0 && !raster.valid[corner[c]])
            return std::nullopt;
        if (weight[c] > 0)
            value += weight[c] * raster.values[corner[c]];
    }
    return value;
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
            const std::size_t k = result.index(column, row);
            const std::optional<double> value =
                interpolate(source, like.centre_x(column), like.centre_y(row));
            result.valid[k] = value.has_value();
            result.values[k] = value.value_or(0);
            met += value.has_value();
        }
    if (met == 0)
        refuse(source.name,
               fmt::format("has no data in common with {}; check the extents of the two", like.name));
    return result;
}

namespace {

using Transformation = std::unique_ptr<OGRCoordinateTransformation>;

Transformation transformation(const Raster& raster, const std::string& from, const std::string& to) {
    OGRSpatialReference source, target;
    if (source.importFromWkt(from.c_str()) != OGRERR_NONE || target.importFromWkt(to.c_str()) != OGRERR_NONE)
        refuse(raster.name, "its coordinate system, or the one it is to be brought to, cannot be read; check "
                            "the .prj files");
    source.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    target.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    Transformation result(OGRCreateCoordinateTransformation(&source, &target));
    if (!result)
        refuse(raster.name, fmt::format("cannot be brought from {} to {} ({})", system_name(from),
                                        system_name(to), last_gdal_message()));
    return result;
}

} // namespace

Raster reproject(const Raster& source, const std::string& target_wkt) {
    start_gdal();
    const auto impossible = [&](const char* what) {
        refuse(source.name,
               fmt::format("cannot be brought from {} to {}: {}; check both systems",
                           system_name(source.coordinate_system), system_name(target_wkt), what));
    };
    const Transformation forth = transformation(source, source.coordinate_system, target_wkt),
                         back = transformation(source, target_wkt, source.coordinate_system);
    // Hull of the old raster's edge on the new map.
    constexpr int per_edge = 64;
    const double wide = source.upper_x() - source.lower_x, high = source.upper_y() - source.lower_y;
    std::vector<double> x, y;
    for (int k = 0; k < per_edge; ++k) {
        const double f = static_cast<double>(k) / per_edge;
        x.insert(x.end(),
                 {source.lower_x + f * wide, source.upper_x(), source.upper_x() - f * wide, source.lower_x});
        y.insert(y.end(),
                 {source.lower_y, source.lower_y + f * high, source.upper_y(), source.upper_y() - f * high});
    }
    if (!forth->Transform(static_cast<int>(x.size()), x.data(), y.data()))
        impossible("its extent lies outside the reach of the projection");
    const auto [left, right] = std::minmax_element(x.begin(), x.end());
    const auto [lower, upper] = std::minmax_element(y.begin(), y.end());
    // A cell in the middle, on the new map.
    const double mx = source.centre_x(source.width / 2), my = source.centre_y(source.height / 2);
    double cx[3] = {mx, mx + source.cell_x, mx}, cy[3] = {my, my, my + source.cell_y};
    if (!forth->Transform(3, cx, cy))
        impossible("its extent lies outside the reach of the projection");
    const double area = std::abs((cx[1] - cx[0]) * (cy[2] - cy[0]) - (cx[2] - cx[0]) * (cy[1] - cy[0]));
    // Finer than the source, so that the new surface follows the old one between its nodes, too.
    int refinement = finest_reprojection;
    while (refinement > 1 &&
           static_cast<double>(source.size()) * refinement * refinement > largest_reprojection)
        refinement /= 2;
    Raster result;
    result.cell_x = result.cell_y = std::sqrt(area) / refinement;
    if (!std::isfinite(result.cell_x) || !(result.cell_x > 0))
        impossible("its cells have no size there");
    result.name = source.name;
    result.coordinate_system = target_wkt;
    const double cell = result.cell_x;
    result.lower_x = std::floor(*left / cell) * cell;
    result.lower_y = std::floor(*lower / cell) * cell;
    const double columns = std::ceil((*right - result.lower_x) / cell),
                 rows = std::ceil((*upper - result.lower_y) / cell);
    if (!(columns * rows <= (16 * static_cast<double>(source.size()) + 1e4) * refinement * refinement))
        impossible("it is stretched beyond use there");
    result.width = static_cast<std::size_t>(columns);
    result.height = static_cast<std::size_t>(rows);
    result.values.assign(result.size(), 0);
    result.valid.assign(result.size(), 0);
    std::vector<int> reached(result.width);
    x.resize(result.width);
    y.resize(result.width);
    for (std::size_t row = 0; row < result.height; ++row) {
        for (std::size_t column = 0; column < result.width; ++column) {
            x[column] = result.centre_x(column);
            y[column] = result.centre_y(row);
        }
        back->Transform(static_cast<int>(x.size()), x.data(), y.data(), nullptr, reached.data());
        for (std::size_t column = 0; column < result.width; ++column) {
            const std::optional<double> value =
                reached[column] ? interpolate(source, x[column], y[column]) : std::nullopt;
            if (!value)
                continue;
            result.values[result.index(column, row)] = *value;
            result.valid[result.index(column, row)] = 1;
        }
    }
    if (result.valid_count() == 0)
        impossible("no cell there gets data");
    return result;
}

namespace {

/// Makes each of these cells the mean of its neighbours with data (Laplace's equation, successive
/// over-relaxation), to a tenth of a millimetre a turn; a plane comes out as a plane.
void relax(Raster& raster, const std::vector<std::size_t>& cells) {
    constexpr int most_turns = 2000;
    constexpr double enough = 1e-4, over = 1.6;
    const std::size_t width = raster.width, height = raster.height;
    double change = 2 * enough;
    for (int turn = 0; turn < most_turns && change > enough; ++turn) {
        change = 0;
        for (const std::size_t k : cells) {
            const std::size_t column = k % width, row = k / width;
            double sum = 0, count = 0;
            const auto take = [&](bool there, std::size_t neighbour) {
                if (!there || !raster.valid[neighbour])
                    return;
                sum += raster.values[neighbour];
                count += 1;
            };
            take(column > 0, k - 1);
            take(column + 1 < width, k + 1);
            take(row > 0, k - width);
            take(row + 1 < height, k + width);
            if (count == 0)
                continue;
            const double step = over * (sum / count - raster.values[k]);
            raster.values[k] += step;
            change = std::max(change, std::abs(step));
        }
    }
}

} // namespace

std::size_t fill_holes(Raster& raster, double reach) {
    start_gdal();
    // Without data and connected to the raster's edge, over sides or corners.
    std::vector<std::uint8_t> outer(raster.size(), 0);
    std::vector<std::size_t> open;
    const auto enter = [&](std::size_t column, std::size_t row) {
        const std::size_t k = raster.index(column, row);
        if (!raster.valid[k] && !outer[k]) {
            outer[k] = 1;
            open.push_back(k);
        }
    };
    for (std::size_t column = 0; column < raster.width; ++column) {
        enter(column, 0);
        enter(column, raster.height - 1);
    }
    for (std::size_t row = 0; row < raster.height; ++row) {
        enter(0, row);
        enter(raster.width - 1, row);
    }
    while (!open.empty()) {
        const std::size_t column = open.back() % raster.width, row = open.back() / raster.width;
        open.pop_back();
        for (std::size_t r = row - std::min<std::size_t>(row, 1); r <= std::min(row + 1, raster.height - 1);
             ++r)
            for (std::size_t c = column - std::min<std::size_t>(column, 1);
                 c <= std::min(column + 1, raster.width - 1); ++c)
                enter(c, r);
    }
    const auto is_hole = [&](std::size_t k) { return !raster.valid[k] && !outer[k]; };
    std::size_t holes = 0;
    double mean = 0; // taken off, since GDALFillNodata calculates in single precision
    const auto count = static_cast<double>(raster.valid_count());
    for (std::size_t k = 0; k < raster.size(); ++k) {
        holes += is_hole(k);
        mean += raster.valid[k] ? raster.values[k] / count : 0;
    }
    if (holes == 0)
        return 0;
    Raster centred = raster;
    for (double& value : centred.values)
        value -= mean;
    const Dataset dataset = in_memory(centred);
    GDALRasterBand* band = dataset->GetRasterBand(1);
    char temporary[] = "TEMP_FILE_DRIVER=MEM";
    char* options[] = {temporary, nullptr};
    if (GDALFillNodata(GDALRasterBand::ToHandle(band), nullptr,
                       std::max(1.0, reach / std::min(raster.cell_x, raster.cell_y)), 0, 0, options, nullptr,
                       nullptr) != CE_None)
        throw Error(ExitCode::run_failed,
                    fmt::format("{}: holes cannot be filled ({})", raster.name, last_gdal_message()));
    std::vector<std::size_t> filled;
    std::vector<double> line(raster.width);
    for (std::size_t row = 0; row < raster.height; ++row) {
        if (band->RasterIO(GF_Read, 0, static_cast<int>(raster.height - 1 - row),
                           static_cast<int>(raster.width), 1, line.data(), static_cast<int>(raster.width), 1,
                           GDT_Float64, 0, 0, nullptr) != CE_None)
            throw Error(ExitCode::run_failed, fmt::format("raster in memory: {}", last_gdal_message()));
        for (std::size_t column = 0; column < raster.width; ++column) {
            const std::size_t k = raster.index(column, row);
            if (!is_hole(k) || line[column] == no_data_value)
                continue;
            raster.values[k] = line[column] + mean;
            raster.valid[k] = 1;
            filled.push_back(k);
        }
    }
    relax(raster, filled);
    return filled.size();
}

std::vector<std::size_t> cells_without_data(const Raster& raster, const Outline& domain) {
    std::vector<std::size_t> result;
    for (std::size_t k = 0; k < raster.size(); ++k)
        if (!raster.valid[k] &&
            domain.contains(raster.centre_x(k % raster.width), raster.centre_y(k / raster.width)))
            result.push_back(k);
    return result;
}

std::string readable_system(const std::string& wkt) {
    return system_name(wkt);
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
