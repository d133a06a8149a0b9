#include <cstring>
#include <limits>

#include "io/io_test.h"
#include "io/scene/colmap.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// Packed little-endian bytes, as COLMAP writes them.
template <class... Values>
std::string pack(const Values&... values) {
    std::string out;
    (out.append(reinterpret_cast<const char*>(&values), sizeof values), ...);
    return out;
}
using U8 = std::uint8_t;
using U32 = std::uint32_t;
using U64 = std::uint64_t;

std::string camera_bin(U32 id, int model = 1, U64 width = 64, U64 height = 48, double focal = 60) {
    return pack(id, model, width, height, focal, focal, 32.0, 24.0);
}
std::string image_bin(U32 id, U32 camera, const std::string& name, double qw = 1, double tx = 0) {
    return pack(id, qw, 0.0, 0.0, 0.0, tx, 0.0, 0.0, camera) + name + std::string(1, '\0') +
           pack(U64{1}, 1.0, 2.0, U64{7});
}

class ColmapTest : public IoTest {
protected:
    void SetUp() override {
        IoTest::SetUp();
        write("cameras.bin", pack(U64{1}) + camera_bin(1));
        write("images.bin",
              pack(U64{2}) + image_bin(1, 1, "b.png") + image_bin(2, 1, "a.png", 1, 5));
        write("points3D.bin", pack(U64{1}, U64{9}, 1.0, 2.0, 3.0, U8{255}, U8{0}, U8{51}, 0.5,
                                   U64{2}, U32{1}, U32{0}, U32{2}, U32{0}));
    }
    void expect_corrupt(const std::string& file, const std::string& bytes) {
        write(file, bytes);
        expect_error(ExitCode::input, "E_COLMAP_CORRUPT: " + (folder / file).string(),
                     [&] { read_all(); });
    }
    void expect_input_error(const std::string& word) {
        expect_error(ExitCode::input, word, [&] { read_all(); });
    }
    void read_all() {
        read_colmap_model(folder.string());
        read_colmap_points(folder.string());
    }
};

TEST_F(ColmapTest, ReadsWhatWasWritten) {
    const ColmapModel model = read_colmap_model(folder.string());
    ASSERT_EQ(model.images.size(), 2u);
    EXPECT_EQ(model.images[0].name, "a.png");  // sorted
    EXPECT_EQ(model.images[0].camera_from_world.t.x, 5);
    EXPECT_EQ(model.cameras.at(1).width_px, 64);
    const ColmapPoints points = read_colmap_points(folder.string());
    ASSERT_EQ(points.positions.size(), 1u);
    EXPECT_EQ(points.positions[0].z, 3);
    EXPECT_EQ(points.track, (std::vector<U32>{1, 2}));
    EXPECT_FLOAT_EQ(points.colors[0].z, 0.2f);
}

TEST_F(ColmapTest, SortsByBytes) {
    write("images.bin", pack(U64{3}) + image_bin(1, 1, "9.png") + image_bin(2, 1, "10.png") +
                            image_bin(3, 1, "Z.png"));
    const ColmapModel model = read_colmap_model(folder.string());
    EXPECT_EQ(model.images[0].name, "10.png");
    EXPECT_EQ(model.images[1].name, "9.png");
    EXPECT_EQ(model.images[2].name, "Z.png");
}

TEST_F(ColmapTest, ImpossibleCounts) {
    const U64 huge[] = {2, U64{1} << 32, U64{1} << 63, ~U64{0}};
    for (const U64 n : huge) {
        expect_corrupt("cameras.bin", pack(n) + camera_bin(1));
        SetUp();
        expect_corrupt("images.bin", pack(n) + image_bin(1, 1, "a.png"));
        SetUp();
        expect_corrupt("points3D.bin",
                       pack(n, U64{9}, 1.0, 2.0, 3.0, U8{0}, U8{0}, U8{0}, 0.5, U64{0}));
        SetUp();
        std::string image = image_bin(1, 1, "a.png");
        image.replace(image.size() - 32, 8, pack(n));
        expect_corrupt("images.bin", pack(U64{1}) + image);
        SetUp();
        expect_corrupt("points3D.bin",
                       pack(U64{1}, U64{9}, 1.0, 2.0, 3.0, U8{0}, U8{0}, U8{0}, 0.5, n));
        SetUp();
    }
}

TEST_F(ColmapTest, Names) {
    for (const std::string& name :
         {std::string(), std::string("/etc/passwd"), std::string("../a.png"),
          std::string("a/../../b.png"), std::string(4097, 'x')}) {
        write("images.bin", pack(U64{1}) + image_bin(1, 1, name));
        expect_input_error("E_BAD_NAME");
    }
    write("images.bin", pack(U64{1}) + image_bin(1, 1, "cam 0/img..v2.png"));
    read_all();
    std::string endless = image_bin(1, 1, "");
    endless.resize(4 + 56 + 4);
    expect_corrupt("images.bin", pack(U64{1}) + endless + std::string(5000, 'x'));
}

TEST_F(ColmapTest, Duplicates) {
    write("cameras.bin", pack(U64{2}) + camera_bin(1) + camera_bin(1));
    expect_input_error("E_DUPLICATE_ID");
    SetUp();
    write("images.bin", pack(U64{2}) + image_bin(1, 1, "a.png") + image_bin(1, 1, "b.png"));
    expect_input_error("E_DUPLICATE_ID");
    write("images.bin", pack(U64{2}) + image_bin(1, 1, "a.png") + image_bin(2, 1, "a.png"));
    expect_input_error("E_DUPLICATE_ID");
}

TEST_F(ColmapTest, MissingCameraNamesThoseThatExist) {
    write("images.bin", pack(U64{1}) + image_bin(1, 4, "a.png"));
    expect_input_error("E_MISSING_CAMERA");
    expect_input_error("refers to camera 4, but the model defines 1");
}

TEST_F(ColmapTest, Cameras) {
    write("cameras.bin", pack(U64{1}) + camera_bin(1, 1, 0));
    expect_input_error("E_CAMERA_SIZE");
    write("cameras.bin", pack(U64{1}) + camera_bin(1, 1, 64, 48, kNan));
    expect_input_error("E_CAMERA_FOCAL");
    write("cameras.bin", pack(U64{1}) + camera_bin(1, 99));
    expect_input_error("E_CAMERA_MODEL");
    write("cameras.bin",
          pack(U64{1}, U32{3}, 16, U64{64}, U64{48}, 60.0, 60.0, 32.0, 24.0, 0.5, 1.0));
    expect_input_error("camera 3 uses EUCM; expected PINHOLE");
}

TEST_F(ColmapTest, Poses) {
    write("images.bin", pack(U64{1}) + image_bin(1, 1, "a.png", kNan));
    expect_input_error("E_POSE_NAN");
    expect_input_error("'a.png'");
    write("images.bin",
          pack(U64{1}) + image_bin(1, 1, "a.png", 1, std::numeric_limits<double>::infinity()));
    expect_input_error("E_POSE_NAN");
    write("images.bin", pack(U64{1}) + image_bin(1, 1, "a.png", 1e-9));
    expect_input_error("E_POSE_QUAT");
    write("images.bin", pack(U64{1}) + image_bin(1, 1, "a.png", -3));  // normalised; -q is q
    EXPECT_EQ(read_colmap_model(folder.string()).images[0].camera_from_world.R[0][0], 1);
}

TEST_F(ColmapTest, PointsThatAreNoPointsAreDropped) {
    const auto point = [](double x) {
        return pack(U64{9}, x, 0.0, 0.0, U8{0}, U8{0}, U8{0}, kNan, U64{1}, U32{1}, U32{0});
    };
    write("points3D.bin", pack(U64{4}) + point(kNan) + point(4) + point(2e9) +
                              point(-std::numeric_limits<double>::infinity()));
    const ColmapPoints points = read_colmap_points(folder.string());
    ASSERT_EQ(points.positions.size(), 1u);
    EXPECT_EQ(points.positions[0].x, 4);
    EXPECT_EQ(points.track_begin, (std::vector<std::size_t>{0, 1}));
    EXPECT_EQ(points.track.size(), 1u);
    fs::remove(folder / "points3D.bin");
    EXPECT_EQ(read_colmap_points(folder.string()).positions.size(), 0u);
}

TEST_F(ColmapTest, BytesAfterTheEndAreIgnored) {
    write("cameras.bin", pack(U64{1}) + camera_bin(1) + "rest");
    EXPECT_EQ(read_colmap_model(folder.string()).cameras.size(), 1u);
}

TEST_F(ColmapTest, BrokenBinaryIsNotReplacedByText) {
    write("cameras.txt", "1 PINHOLE 64 48 60 60 32 24\n");
    expect_corrupt("cameras.bin", "abc");
    fs::remove(folder / "cameras.bin");
    EXPECT_EQ(read_colmap_model(folder.string()).cameras.at(1).fx_px, 60);
}

class ColmapText : public ColmapTest {
protected:
    void SetUp() override {
        ColmapTest::SetUp();
        for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"})
            fs::remove(folder / name);
        write("cameras.txt", "# comment\r\n\r\n1 PINHOLE 64 48 60 60 32 24\r\n");
        write("images.txt",
              "# comment\n2 1 0 0 0 5 0 0 1 a b.png\n\n1 1 0 0 0 0 0 0 1 c.png\n1 2 -1");
        write("points3D.txt", "");
    }
};

TEST_F(ColmapText, EmptyObservationLinesBlanksAndCarriageReturns) {
    const ColmapModel model = read_colmap_model(folder.string());
    ASSERT_EQ(model.images.size(), 2u);
    EXPECT_EQ(model.images[0].name, "a b.png");
    EXPECT_EQ(model.images[0].camera_from_world.t.x, 5);
    EXPECT_EQ(read_colmap_points(folder.string()).positions.size(), 0u);
}

TEST_F(ColmapText, WrongLinesAreNamed) {
    const char* cameras[] = {"1",
                             "x PINHOLE 64 48 60 60 32 24",
                             "1 PINHOLE 64 48 60 60 32",
                             "1 PINHOLE 64 48 60 60 32 24 1",
                             "1 PINHOLE 64 48 60 6O 32 24",
                             "-1 PINHOLE 64 48 60 60 32 24",
                             "1 PINHOLE 64 4.5 60 60 32 24"};
    for (const char* line : cameras) {
        write("cameras.txt", line);
        expect_input_error("E_COLMAP_CORRUPT");
        expect_input_error("cameras.txt: line 1");
    }
    write("cameras.txt", "1 NO_SUCH 64 48 60");
    expect_input_error("E_CAMERA_MODEL");
    write("cameras.txt", "1 EUCM 64 48 60");
    expect_input_error("camera 1 uses EUCM; expected PINHOLE");
    write("cameras.txt", "1 OPENCV 64 48 60 60");
    expect_input_error("line 1: 2 parameters; expected the 8 of OPENCV");
    SetUp();
    for (const char* line : {"2 1 0 0 0 5 0", "2 1 0 0 0 5 0 0 1 a.png\n1 1 0 0 0 0 0 0 1 b.png\n",
                             "2 1 0 0 0 5 0 0 99999999999 a.png"}) {
        write("images.txt", line);
        expect_input_error("E_COLMAP_CORRUPT");
    }
    write("images.txt", "2 1 0 0 0 5 0 0 1\n\n");
    expect_input_error("E_BAD_NAME");
    write("images.txt", "2 nan 0 0 0 5 0 0 1 a.png\n\n");
    expect_input_error("E_POSE_NAN");
    SetUp();
    for (const char* line :
         {"1 2 3", "1 0 0 0 256 0 0 0", "1 0 0 0 1 1 1 0 4", "1 0 0 zero 1 1 1 0"}) {
        write("points3D.txt", line);
        expect_input_error("E_COLMAP_CORRUPT");
    }
}

class ColmapExample : public IoTest {
protected:
    void SetUp() override { IoTest::SetUp(); }
    void copy_with(const char* extension) const {
        for (const char* name : {"cameras", "images", "points3D"})
            fs::copy_file(kExample / "colmap" / str(name, extension), folder / str(name, extension),
                          fs::copy_options::overwrite_existing);
    }
};

TEST_F(ColmapExample, BinaryAndTextAreTheSameAndAsExpected) {
    const std::string binary = (kExample / "colmap").string();
    copy_with(".txt");
    const ColmapModel a = read_colmap_model(binary), b = read_colmap_model(folder.string());
    ASSERT_EQ(a.images.size(), 2u);
    ASSERT_EQ(b.images.size(), 2u);
    for (std::size_t i = 0; i < 2; ++i) {
        EXPECT_EQ(a.images[i].id, b.images[i].id);
        EXPECT_EQ(a.images[i].camera_id, b.images[i].camera_id);
        EXPECT_EQ(a.images[i].name, b.images[i].name);
        EXPECT_EQ(std::memcmp(&a.images[i].camera_from_world, &b.images[i].camera_from_world,
                              sizeof(Rigid3d)),
                  0);
    }
    EXPECT_EQ(a.images[0].name, "a/0001.png");
    EXPECT_EQ(a.images[1].name, "b/0001.png");
    for (const U32 id : {1u, 7u}) {
        EXPECT_EQ(a.cameras.at(id).fx_px, b.cameras.at(id).fx_px);
        EXPECT_EQ(a.cameras.at(id).cy_px, b.cameras.at(id).cy_px);
    }
    EXPECT_EQ(a.cameras.at(1).fy_px, 510);
    EXPECT_EQ(a.cameras.at(7).fy_px, 250);
    // EXPECTED.txt; the quaternion has 17 digits, so only rounding is left.
    const Vec3d centre0 = inverse(a.images[0].camera_from_world).t,
                centre1 = inverse(a.images[1].camera_from_world).t;
    EXPECT_NEAR(norm(centre0 - Vec3d{0, 0, -2}), 0, 1e-12);
    EXPECT_NEAR(norm(centre1 - Vec3d{3, -2, -1}), 0, 1e-12);

    const ColmapPoints p = read_colmap_points(binary), q = read_colmap_points(folder.string());
    ASSERT_EQ(p.positions.size(), 2u);
    ASSERT_EQ(q.positions.size(), 2u);
    EXPECT_EQ(std::memcmp(p.positions.data(), q.positions.data(), 2 * sizeof(Vec3d)), 0);
    EXPECT_EQ(p.track, (std::vector<U32>{3}));
    EXPECT_EQ(p.track, q.track);
    EXPECT_EQ(p.track_begin, q.track_begin);
    EXPECT_EQ(p.track_observation, q.track_observation);
    for (std::size_t i = 0; i < a.images.size(); ++i) {
        ASSERT_EQ(a.images[i].observations.size(), b.images[i].observations.size());
        for (std::size_t j = 0; j < a.images[i].observations.size(); ++j)
            EXPECT_EQ(a.images[i].observations[j].y, b.images[i].observations[j].y);
    }
}

TEST_F(ColmapExample, EveryPrefixIsAnError) {
    for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
        const std::string whole = read_bytes((kExample / "colmap" / name).string());
        copy_with(".bin");
        for (std::size_t size = 0; size < whole.size(); ++size) {
            write(name, whole.substr(0, size));
            expect_error(ExitCode::input, "E_COLMAP_CORRUPT", [&] {
                read_colmap_model(folder.string());
                read_colmap_points(folder.string());
            });
        }
    }
}

TEST_F(ColmapExample, NoPrefixOfTheTextAndNoChangedByteCrashes) {
    for (const char* name : {"cameras", "images", "points3D"})
        for (const char* extension : {".txt", ".bin"}) {
            const std::string file = str(name, extension);
            const std::string whole = read_bytes((kExample / "colmap" / file).string());
            fs::remove_all(folder);
            fs::create_directories(folder);
            copy_with(extension);
            for (std::size_t i = 0; i < 2 * whole.size(); ++i) {
                std::string changed = whole;
                if (i < whole.size())
                    changed.resize(i);
                else
                    changed[i - whole.size()] = static_cast<char>(changed[i - whole.size()] ^ 0xFF);
                write(file, changed);
                try {
                    read_colmap_model(folder.string());
                    read_colmap_points(folder.string());
                } catch (const Error& error) {
                    EXPECT_EQ(static_cast<int>(error.code()), static_cast<int>(ExitCode::input));
                    EXPECT_EQ(std::string(error.what()).substr(0, 2), "E_");
                }
            }
        }
}

}  // namespace
}  // namespace tvsgs
