// Control points, and places of cameras in EXIF: a made scene gets its known scale and place.
#include <cmath>

#include "apps/prepare/control_points.h"
#include "core/log.h"
#include "core/math/rng.h"
#include "prepare/prepare_test.h"

namespace tvsgs::prepare {
namespace {

const std::vector<std::string> kNames = {"a.jpg", "b.jpg", "c.jpg", "d.jpg", "e.jpg", "f.jpg"};
// Far away, as gcp_list.txt has it: easting and northing in metres.
const Similarity kTruth{
    7.3, rotation(normalize(Quat<double>{0.7, 0.5, -0.4, 0.3})), {4512345.25, 5337600.5, 512}};

/// A surveyed scene: nine points in the frame of the model, with marks in all photographs. A pixel
/// is a centimetre wide there.
struct Survey {
    SparseModel model = made_model(kNames);
    std::vector<Vec3d> places;  // in the model
    ControlPoints points;

    explicit Survey(double noise_px = 0) {
        model.cameras[0] = {1, 4, 4000, 3000, {3500, 3550, 2000, 1500, -0.1, 0.02, 1e-3, -2e-3}};
        const Intrinsics in = intrinsics_of(model.cameras[0]);
        points.list.path = "gcp_list.txt", points.list.projection = "EPSG:32632";
        int line = 1;
        for (int i = 0; i < 9; ++i) {
            places.push_back({0.9 * std::cos(2.4 * i), 0.9 * std::sin(2.4 * i), 0.1 * (i % 4)});
            ControlPoint point{str("p", i), kTruth * places.back(), {}};
            for (const SparseImage& image : model.images) {
                const Random4 r = random4(3, RandomStream::patches, std::uint64_t(++line), 0u);
                Vec2<double> at = project(in, image.camera_from_world(), places.back());
                at.x += noise_px * (r.v[0] / 2147483648.0 - 1);
                at.y += noise_px * (r.v[1] / 2147483648.0 - 1);
                point.marks.push_back({image.name, at, line});
            }
            points.list.points.push_back(point);
        }
    }
    /// Largest error of the frame at the points, metres.
    double error(const GeoFrame& frame) const {
        double worst = 0;
        for (const Vec3d p : places) worst = std::max(worst, norm(frame.to_world * p - kTruth * p));
        return worst;
    }
};

const JsonValue& line_of(const GeoFrame& frame, const std::string& name) {
    for (const JsonValue& line : frame.report["points"].items)
        if (line["name"].text == name) return line;
    throw std::out_of_range(name);
}

double length(const JsonValue& error) {
    return std::hypot(error.items.at(0).number, error.items.at(1).number, error.items.at(2).number);
}

TEST(ControlPoints, GiveScaleAndPlaceInDouble) {
    Survey survey;
    const GeoFrame frame = place_by_control_points(survey.model, survey.points);
    EXPECT_LT(survey.error(frame), 1e-6);  // roundings of coordinates of 5e6 are 1e-9
    EXPECT_NEAR(frame.to_world.scale, 7.3, 1e-9);
    EXPECT_EQ(frame.projection, "EPSG:32632");
    // The model keeps the digits, in memory and in its files.
    move(survey.model, frame.to_world);
    const Intrinsics in = intrinsics_of(survey.model.cameras[0]);
    for (const ControlPoint& point : survey.points.list.points)
        for (std::size_t k = 0; k < kNames.size(); ++k) {
            const Vec2<double> at =
                project(in, survey.model.images[k].camera_from_world(), point.position);
            EXPECT_NEAR(at.x, point.marks[k].place.x, 1e-3);
            EXPECT_NEAR(at.y, point.marks[k].place.y, 1e-3);
        }
}

TEST(ControlPoints, OutliersAndCheckpointsAreLeftOut) {
    Survey survey(0.5);
    std::vector<ControlPoint>& points = survey.points.list.points;
    points[2].position.y += 3;         // a wrong coordinate
    points[4].marks[1].place.x += 80;  // a wrong mark
    survey.points.checkpoints = {"p6", "p7"};
    points[7].position.z += 0.5;  // a checkpoint that would move the fit
    const GeoFrame frame = place_by_control_points(survey.model, survey.points);
    EXPECT_LT(survey.error(frame), 0.02);  // two pixels
    EXPECT_EQ(line_of(frame, "p2")["use"].text, "outlier");
    EXPECT_NEAR(length(line_of(frame, "p2")["error_m"]), 3, 0.03);
    EXPECT_NEAR(line_of(frame, "p2")["error_m"].items.at(1).number, -3, 0.03);
    EXPECT_EQ(line_of(frame, "p4")["use"].text, "fitted");
    EXPECT_EQ(line_of(frame, "p4")["marks"].number, 5);
    EXPECT_LT(line_of(frame, "p4")["residual_px"].number, 1);
    EXPECT_EQ(line_of(frame, "p6")["use"].text, "checkpoint");
    EXPECT_NEAR(length(line_of(frame, "p7")["error_m"]), 0.5, 0.03);
    EXPECT_NEAR(frame.report["checkpoint_rmse_m"].number, 0.5 / std::sqrt(2.0), 0.03);
    EXPECT_LT(frame.report["rmse_m"].number, 0.02);
    int fitted = 0;
    for (const JsonValue& line : frame.report["points"].items)
        fitted += line["use"].text == "fitted";
    EXPECT_EQ(fitted, 6);
}

TEST(ControlPoints, OneOfThreeMarksMayBeWrong) {
    Survey survey(0.3);
    ControlPoint point = survey.points.list.points[0];
    point.marks.resize(3);
    point.marks[1].place.y -= 60;
    FoundPoint found = find_point(survey.model, point);
    ASSERT_TRUE(found.position);
    EXPECT_EQ(found.dropped, std::vector<int>{point.marks[1].line});
    EXPECT_LT(norm(*found.position - survey.places[0]), 0.005);
    // Two marks that do not meet, one mark, and a photograph without a pose give no point.
    point.marks.resize(2);
    EXPECT_FALSE(find_point(survey.model, point).position);
    point.marks[1].image = "z.jpg";
    EXPECT_FALSE(find_point(survey.model, point).position);
}

TEST(ControlPoints, OneOfFourPointsMayBeWrong) {
    Survey survey(0.3);
    survey.points.list.points.resize(4);
    survey.points.list.points[3].position.x += 2;
    const GeoFrame frame = place_by_control_points(survey.model, survey.points);
    EXPECT_EQ(line_of(frame, "p3")["use"].text, "outlier");
    EXPECT_LT(survey.error(frame), 0.05);
}

TEST(ControlPoints, ALineOrTwoPointsGiveNoFrame) {
    const auto place = [](Survey& survey) {
        return place_by_control_points(survey.model, survey.points);
    };
    Survey two;
    two.points.list.points.resize(2);
    expect_error(ExitCode::input, "gcp_list.txt: 2 places to fit; expected at least 3",
                 [&] { place(two); });
    Survey line;
    const Intrinsics in = intrinsics_of(line.model.cameras[0]);
    for (std::size_t i = 0; i < 9; ++i) {
        const Vec3d at{0.2 * double(i) - 0.8, 0.1 * double(i), 0.002 * double(i % 2)};
        line.points.list.points[i].position = kTruth * at;
        for (std::size_t k = 0; k < kNames.size(); ++k)
            line.points.list.points[i].marks[k].place =
                project(in, line.model.images[k].camera_from_world(), at);
    }
    expect_error(ExitCode::input, "9 places on one line", [&] { place(line); });
    // Wide enough for exact coordinates, too narrow for coordinates that are off by a metre.
    const std::vector<Vec3d> band = {{0, 0, 0}, {10, 1, 0}, {20, 0, 0}, {30, 1, 0}};
    const auto errors = [](Vec3d e) { return std::vector<Vec3d>{e, -e, e, -e}; };
    require_rotation(band, errors({0, 0, 0.1}), "x");
    require_rotation(band, errors({5, 5, 0}), "x");  // these do not turn the band
    expect_error(ExitCode::input, "spread 11.2 m and 0.447 m, with residuals of 1 m out of", [&] {
        require_rotation(band, errors({0, 0, 1}), "x");
    });
    expect_error(ExitCode::input, "on one line", [&] {
        require_rotation({{1, 1, 1}, {1, 1, 1}, {1, 1, 1}}, {}, "x");
    });
}

TEST(ControlPoints, ManyPlacesMayHaveAThirdOfOutliers) {
    std::vector<Vec3d> model, world;
    for (std::uint64_t i = 0; i < 90; ++i) {
        const Random4 r = random4(5, RandomStream::patches, i, 0u);
        const auto unit = [&](int k) { return r.v[k] / 4294967296.0; };
        model.push_back({unit(0), unit(1), 0.3 * unit(2)});
        world.push_back(kTruth * model.back() + Vec3d{0.02 * unit(3), 0, 0.02 * unit(0)});
        if (i % 3 == 0) world.back() += Vec3d{2 + unit(3), -1, 4 * unit(1)};
    }
    const Fit fit = fit_without_outliers(model, world, 0.01, "x");
    for (std::size_t i = 0; i < 90; ++i) {
        EXPECT_EQ(fit.inlier[i], i % 3 != 0) << i;
        EXPECT_LT(norm(fit.world_from_model * model[i] - kTruth * model[i]), 0.03) << i;
    }
}

class ControlLists : public IoTest {
protected:
    ControlList list(const std::string& text) const {
        return read_control_list(write("gcp_list.txt", text));
    }
    void refused(const std::string& text, const std::string& why) const {
        expect_error(ExitCode::input, why, [&] { list(text); });
    }
    /// Photographs of 100x80 pixels.
    std::vector<Photograph> photographs() const {
        std::vector<Photograph> out;
        for (const char* name : {"a.jpg", "b.jpg", "left/c.jpg", "right/c.jpg"}) {
            Photograph photo;
            photo.file = std::string("/photos/") + name, photo.name = name;
            photo.width = 100, photo.height = 80;
            out.push_back(photo);
        }
        return out;
    }
};

TEST_F(ControlLists, AreReadInTheirForms) {
    const ControlList a = list(
        "\xEF\xBB\xBF# surveyed in May\r\n\r\n EPSG:32611 \r\n"
        "235269.88\t3811198.11\t0.0\t1804.436\t1146.648\tIMG_0037.jpg\tgcp02\textra 1\r\n"
        "1 2 3 4 5 IMG_1.jpg\n# 1 2 3\n235269.88 3811198.11 0 7 8.5 IMG_2.jpg gcp02\n"
        "1 2 3 6 7 IMG_2.jpg\n1 2 4 6 7 IMG_3.jpg");
    EXPECT_EQ(a.projection, "EPSG:32611");
    ASSERT_EQ(a.points.size(), 3u);
    EXPECT_EQ(a.points[0].name, "gcp02");
    EXPECT_EQ(a.points[0].position.x, 235269.88);
    ASSERT_EQ(a.points[0].marks.size(), 2u);
    EXPECT_EQ(a.points[0].marks[0].image, "IMG_0037.jpg");
    EXPECT_EQ(a.points[0].marks[1].place.y, 8.5);
    EXPECT_EQ(a.points[0].marks[1].line, 7);
    EXPECT_EQ(a.points[1].name, "line 5");
    EXPECT_EQ(a.points[1].marks.size(), 2u);
    EXPECT_EQ(a.points[2].name, "line 9");
    const std::string point = "\n1 2 3 4 5 a.jpg\n", proj = "+proj=utm +zone=11 +units=m +no_defs";
    EXPECT_EQ(list(proj + point).projection, proj);
    EXPECT_EQ(list("WGS84 UTM 32N" + point).projection, "EPSG:32632");
    EXPECT_EQ(list("WGS84 UTM 7 S" + point).projection, "EPSG:32707");
    EXPECT_TRUE(list("epsg:4326" + point).degrees);
    EXPECT_TRUE(list("+proj=longlat +datum=WGS84" + point).degrees);
    EXPECT_FALSE(list(proj + point).degrees);
}

TEST_F(ControlLists, WrongLinesAreNamed) {
    expect_error(ExitCode::input, "none.txt", [&] { read_control_list("none.txt"); });
    refused("", "has no control points");
    refused("EPSG:32632\n", "has no control points");
    refused("1 2 3 4 5 a.jpg\n", "gcp_list.txt:1: '1 2 3 4 5 a.jpg' is no projection; expected");
    refused("EPSG:abc\n", "'EPSG:abc' is no projection");
    refused("EPSG:4258\n1 2 3 4 5 a.jpg\n", "within 180 in EPSG:4258, so they seem to be degrees");
    refused("+proj=lcc +to_meter=0.3048006\n", "the unit is '0.3048006 m'");
    refused("WGS84 UTM 61N\n", "is no projection");
    refused("+proj=lcc +units=us-ft\n", "gcp_list.txt:1: the unit is 'us-ft'; expected metres");
    const std::string head = "EPSG:32632\n";
    refused(head + "\n1 2 3 4 a.jpg\n", "gcp_list.txt:3: 5 columns; expected \"x y z px py image");
    refused(head + "1 2 nan 4 5 a.jpg\n", ":2: z is 'nan'; expected a number");
    refused(head + "1 2 3 4 inf a.jpg\n", ":2: py is 'inf'");
    refused(head + "1 2 3 4 1,5 a.jpg\n", ":2: py is '1,5'");
    refused(head + "1 2e9 3 4 5 a.jpg\n", ":2: y is '2e9'; expected a number within 1e9");
    refused(head + "1 2 3 4 5 a.jpg p\n1 2 3.5 4 5 b.jpg p\n",
            ":3: 'p' has other coordinates than in line 2");
    refused("EPSG:4326\n691200 5337600 3 4 5 a.jpg\n", "expected longitude and latitude");
}

TEST_F(ControlLists, AreCheckedAgainstThePhotographs) {
    const std::string first =
        "EPSG:32632\n0 0 0 4 5 a.jpg p\n0 0 0 4 5 b.jpg p\n9 0 0 4 5 a.jpg q\n9 0 0 4 5 b.jpg q\n";
    const std::string more = "0 9 0 4 5 a.jpg r\n0 9 0 4 5 c.jpg r\n0 9 5 1 1 b.jpg s\n";
    const auto read = [&](const std::string& text, const std::string& checkpoints = "") {
        return read_control_points(write("g.txt", text), photographs(), checkpoints);
    };
    const auto refused_here = [&](const std::string& text, const std::string& why) {
        expect_error(ExitCode::input, why, [&] { read(text); });
    };
    refused_here(first + "0 9 0 4 5 x.jpg r\n",
                 "g.txt:6: no photograph 'x.jpg'; expected one of the 4 files, such as a.jpg");
    refused_here(first + more, "g.txt:7: 'c.jpg' may be left/c.jpg or right/c.jpg");
    refused_here(first + "0 9 0 100.5 5 a.jpg r\n",
                 "g.txt:6: px py 100.5 5 lies outside of a.jpg, 100x80 pixels");
    refused_here(first + "0 0 0 9 9 b.jpg p\n", "'p' is marked in b.jpg in line 3 already");
    refused_here(first, "g.txt: 2 points to fit with marks in two or more photographs; expected");
    std::string good = first + more;
    good.replace(good.find("c.jpg"), 5, "right/c.jpg");
    const ControlPoints points = read(good);
    EXPECT_EQ(points.list.points[2].marks[1].image, "right/c.jpg");
    expect_error(ExitCode::input, "2 points to fit with marks in two or more photographs, without",
                 [&] { read(good, "q"); });
    expect_error(ExitCode::usage, "has no point 'gcp'; expected names of p, q, r, s",
                 [&] { read(good, "p,gcp"); });
    EXPECT_EQ(read(good, " s, ").checkpoints, std::set<std::string>{"s"});
    good.replace(good.find("0 9 0 4 5 a.jpg r"), 5, "5 0 0");
    good.replace(good.find("0 9 0 4 5 right"), 5, "5 0 0");
    refused_here(good, "g.txt: 3 places on one line");
    // Degrees become metres in a local frame.
    const ControlPoints local = read(
        "EPSG:4326\n11 48 500 4 5 a.jpg p\n11 48 500 4 5 b.jpg p\n11.001 48 500 4 5 a.jpg q\n"
        "11.001 48 500 4 5 b.jpg q\n11 48.001 500 4 5 a.jpg r\n11 48.001 500 4 5 b.jpg r\n");
    EXPECT_TRUE(local.list.projection.starts_with("+proj=pipeline +step +proj=cart"));
    EXPECT_NEAR(norm(local.list.points[1].position - local.list.points[0].position), 74.6312, 1e-3);
    EXPECT_NEAR(norm(local.list.points[2].position - local.list.points[0].position), 111.1991,
                1e-2);
    const LocalFrame date_line({{48, 179.9995, 500}, {48, -179.9995, 500}});
    EXPECT_NEAR(norm(date_line({48, 179.9995, 500})), 37.3156, 1e-3);
    EXPECT_NEAR(norm(date_line({48, -179.9995, 500})), 37.3156, 1e-3);
}

/// The swap of the axes is a mirror, which flat points fit upside down.
TEST(ControlPoints, SwappedAxesAreSaid) {
    init_log(Verbosity::normal);
    testing::internal::CaptureStderr();
    Survey survey;
    const Intrinsics in = intrinsics_of(survey.model.cameras[0]);
    move(survey.model, kTruth);
    for (std::size_t i = 0; i < 9; ++i) {
        const Vec3d at{survey.places[i].x, survey.places[i].y, 0};
        ControlPoint& point = survey.points.list.points[i];
        point.position = {at.y, at.x, 0};
        for (std::size_t k = 0; k < kNames.size(); ++k)
            point.marks[k].place =
                project(in, survey.model.images[k].camera_from_world(), kTruth * at);
    }
    place_by_control_points(survey.model, survey.points);
    EXPECT_NE(testing::internal::GetCapturedStderr().find("are x (east) and y (north) swapped"),
              std::string::npos);
}

/// The EXIF data of a photograph with a place: 48 degrees 8' 14.25", 11 degrees 34' 30.5", 519.5 m.
std::string exif_with_place(bool big_endian, char north, char east, char below) {
    std::string tiff = big_endian ? std::string("MM\0\x2A", 4) : std::string("II\x2A\0", 4);
    const auto put = [&](std::uint32_t value, int bytes) {
        for (int i = 0; i < bytes; ++i)
            tiff += static_cast<char>(value >> 8 * (big_endian ? bytes - 1 - i : i) & 0xFF);
    };
    const auto entry = [&](std::uint32_t tag, std::uint32_t type, std::uint32_t count) {
        put(tag, 2), put(type, 2), put(count, 4);
    };
    put(8, 4), put(1, 2), entry(0x8825, 4, 1), put(26, 4), put(0, 4);
    put(6, 2);
    entry(1, 2, 2), tiff += std::string{north, 0, 0, 0};
    entry(2, 5, 3), put(104, 4);
    entry(3, 2, 2), tiff += std::string{east, 0, 0, 0};
    entry(4, 5, 3), put(128, 4);
    entry(5, 1, 1), tiff += std::string{below, 0, 0, 0};
    entry(6, 5, 1), put(152, 4), put(0, 4);
    for (const std::uint32_t n :
         {48u, 1u, 8u, 1u, 1425u, 100u, 11u, 1u, 34u, 1u, 305u, 10u, 1039u, 2u})
        put(n, 4);
    const std::string exif = std::string("Exif\0\0", 6) + tiff;
    return std::string("\xFF\xD8\xFF\xE1\0", 5) + static_cast<char>(exif.size() + 2) + exif +
           "\xFF\xDA";
}

TEST(ExifPlaces, AreReadInBothByteOrders) {
    const double north = 48 + 8 / 60.0 + 14.25 / 3600, east = 11 + 34 / 60.0 + 30.5 / 3600;
    for (const bool big : {false, true}) {
        Exif exif = read_exif(exif_with_place(big, 'N', 'E', 0));
        ASSERT_TRUE(exif.place);
        EXPECT_NEAR(exif.place->latitude_deg, north, 1e-12);
        EXPECT_NEAR(exif.place->longitude_deg, east, 1e-12);
        EXPECT_EQ(exif.place->height_m, 519.5);
        exif = read_exif(exif_with_place(big, 'S', 'W', 1));
        ASSERT_TRUE(exif.place);
        EXPECT_NEAR(exif.place->latitude_deg, -north, 1e-12);
        EXPECT_NEAR(exif.place->longitude_deg, -east, 1e-12);
        EXPECT_EQ(exif.place->height_m, -519.5);
        EXPECT_FALSE(read_exif(exif_with_place(big, 0, 'E', 0)).place);
    }
    // Damage: every shorter file, a denominator of zero, a latitude of 148, and zeros.
    const std::string whole = exif_with_place(true, 'N', 'E', 0);
    for (std::size_t size = 0; size < whole.size() - 2; ++size)
        EXPECT_FALSE(read_exif(std::string_view(whole).substr(0, size)).place) << size;
    constexpr std::size_t kNumbers = 12 + 104;
    for (const auto& [at, value] : {std::pair{std::size_t{7}, 0}, {3, 148}}) {
        std::string bytes = whole;
        bytes[kNumbers + at] = static_cast<char>(value);
        EXPECT_FALSE(read_exif(bytes).place) << at;
    }
    std::string zeros = whole;
    for (std::size_t i = 0; i < 12; ++i)
        for (std::size_t k = 0; k < 4; ++k)
            if (i % 2 == 0) zeros[kNumbers + 4 * i + k] = 0;
    EXPECT_FALSE(read_exif(zeros).place);
}

TEST(ExifPlaces, BecomeEastNorthAndUp) {
    const GeodeticPlace home{48, 11, 500};
    const LocalFrame frame({home, home, {10, 20, 3000}});  // the median
    EXPECT_LT(norm(frame(home)), 1e-8);
    // As `cct` of PROJ 9.1 converts them with this pipeline.
    for (const auto& [place, expected] :
         {std::pair{GeodeticPlace{48.001, 11, 500}, Vec3d{0, 111.199059, -0.000970}},
          {{48, 11.001, 500}, {74.631193, 0.000484, -0.000436}},
          {{48.01, 11.02, 620}, {1492.363369, 1112.205968, 119.728672}}})
        EXPECT_LT(norm(frame(place) - expected), 2e-6);
    EXPECT_EQ(frame.projection(),
              "+proj=pipeline +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
              "+lat_0=48.0000000 +lon_0=11.0000000 +h_0=500.00");
}

/// Twelve cameras on a bent path.
struct Flight {
    SparseModel model;
    std::vector<Photograph> photographs;
    std::vector<Vec3d> world;

    explicit Flight(double bend) {
        std::vector<GeodeticPlace> places;
        std::vector<std::string> names;
        for (int i = 0; i < 12; ++i) {
            names.push_back(str("f", 10 + i, ".jpg"));
            places.push_back({48 + 1e-5 * i, 11 + bend * 1e-6 * i * i, 500 + bend * (i % 2)});
        }
        const LocalFrame frame(places);
        model = made_model(names);
        for (std::size_t i = 0; i < places.size(); ++i) {
            world.push_back(frame(places[i]));
            const Vec3d centre =
                (1 / kTruth.scale) * transpose_times(kTruth.R, world[i] - Vec3d{100, 200, 3});
            SparseImage& image = model.images[i];
            image.translation = -(image.camera_from_world().R * centre);
            Photograph photo;
            photo.name = names[i], photo.place = places[i];
            photographs.push_back(photo);
        }
    }
};

TEST(ExifPlaces, PutTheCamerasInPlace) {
    Flight flight(1);
    flight.photographs[3].place->height_m += 40;
    flight.photographs[8].place->longitude_deg += 0.001;
    flight.photographs[5].place.reset();
    const GeoFrame frame = place_by_exif(flight.model, flight.photographs);
    EXPECT_NEAR(frame.to_world.scale, kTruth.scale, 1e-6);
    // The frame is at the median of other places than that of the flight: compare distances.
    const auto at = [&](std::size_t i) {
        return frame.to_world * inverse(flight.model.images[i].camera_from_world()).t;
    };
    for (std::size_t i = 1; i < 12; ++i)
        EXPECT_NEAR(norm(at(i) - at(0)), norm(flight.world[i] - flight.world[0]), 1e-5) << i;
    ASSERT_EQ(frame.report["cameras"].items.size(), 11u);
    for (const JsonValue& camera : frame.report["cameras"].items)
        EXPECT_EQ(camera["use"].text == "outlier",
                  camera["image"].text == "f13.jpg" || camera["image"].text == "f18.jpg");

    Flight straight(0);
    expect_error(ExitCode::input, "--gps: 12 places on one line",
                 [&] { place_by_exif(straight.model, straight.photographs); });
    flight.photographs.resize(2);
    expect_error(ExitCode::input, "2 photographs have a pose and a place in EXIF",
                 [&] { place_by_exif(flight.model, flight.photographs); });
    expect_error(ExitCode::input, "--gps: 2 of the 2 photographs in photos have a place",
                 [&] { require_places(flight.photographs, "photos"); });
}

}  // namespace
}  // namespace tvsgs::prepare
