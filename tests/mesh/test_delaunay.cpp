// Checks Delaunay tetrahedra against their definition, in exact arithmetic.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "core/math/rng.h"
#include "mesh/tetrahedra/delaunay.h"

namespace tvsgs {
namespace {

constexpr int kMax = (1 << kGridBits) - 1;

/// Determinant of a matrix of small integers by cofactors, independent of the predicates.
detail::Int128 determinant(const std::vector<std::vector<detail::Int128>>& m) {
    if (m.size() == 1) return m[0][0];
    detail::Int128 sum = 0;
    for (std::size_t j = 0; j < m.size(); ++j) {
        std::vector<std::vector<detail::Int128>> minor;
        for (std::size_t r = 1; r < m.size(); ++r) {
            minor.emplace_back();
            for (std::size_t c = 0; c < m.size(); ++c)
                if (c != j) minor.back().push_back(m[r][c]);
        }
        sum += (j % 2 ? -1 : 1) * m[0][j] * determinant(minor);
    }
    return sum;
}
int exact_orientation(Vec3i a, Vec3i b, Vec3i c, Vec3i d) {
    std::vector<std::vector<detail::Int128>> rows;
    for (const Vec3i p : {b - a, c - a, d - a}) rows.push_back({p.x, p.y, p.z});
    return detail::sign(determinant(rows));
}
int exact_in_sphere(Vec3i a, Vec3i b, Vec3i c, Vec3i d, Vec3i p) {
    std::vector<std::vector<detail::Int128>> rows;
    for (const Vec3i q : {a - p, b - p, c - p, d - p}) {
        const detail::Int128 x = q.x, y = q.y, z = q.z;
        rows.push_back({x, y, z, x * x + y * y + z * z});
    }
    return -detail::sign(determinant(rows));
}

Random4 draw(std::uint64_t seed, int i) {
    return random4(seed, RandomStream::test, static_cast<std::uint64_t>(i));
}
Vec3i random_point(std::uint64_t seed, int i, int extent = kMax) {
    const Random4 r = draw(seed, i);
    const auto in = [&](int axis) {
        return static_cast<int>(uniform(r.v[axis]) * static_cast<float>(extent));
    };
    return {in(0), in(1), in(2)};
}

TEST(GridPredicates, AgreeWithCofactorsAlsoWhereTheyVanish) {
    // By hand: the corner tetrahedron is positive, and its sphere goes through the cube's corners.
    const Vec3i o{0, 0, 0}, x{2, 0, 0}, y{0, 2, 0}, z{0, 0, 2};
    EXPECT_EQ(orientation(o, x, y, z), 1);
    EXPECT_EQ(in_sphere(o, x, y, z, {1, 1, 1}), 1);
    EXPECT_EQ(in_sphere(o, x, y, z, {2, 2, 2}), 0);
    EXPECT_EQ(in_sphere(o, x, y, z, {3, 2, 2}), -1);
    int zeros = 0, by_one = 0;
    for (int i = 0; i < 2000; ++i) {
        // Small grids make flat and cospherical cases; a factor takes them to the largest numbers.
        const int extent = 2 + i % 5, factor = i % 2 ? kMax / extent : 1;
        Vec3i p[5];
        for (int k = 0; k < 5; ++k) p[k] = factor * random_point(i, k, extent);
        if (i % 3 == 0) p[4].x = std::min(p[4].x + 1, kMax), ++by_one;  // next to zero
        EXPECT_EQ(orientation(p[0], p[1], p[2], p[4]), exact_orientation(p[0], p[1], p[2], p[4]));
        const int side = exact_in_sphere(p[0], p[1], p[2], p[3], p[4]);
        EXPECT_EQ(in_sphere(p[0], p[1], p[2], p[3], p[4]), side);
        zeros += side == 0;
    }
    EXPECT_GT(zeros, 200);
    // The largest numbers allowed.
    EXPECT_EQ(orientation({0, 0, 0}, {kMax, 0, 0}, {0, kMax, 0}, {kMax, kMax, 1}), 1);
    EXPECT_EQ(in_sphere({0, 0, 0}, {kMax, 0, 0}, {0, kMax, 0}, {0, 0, kMax}, {kMax, kMax, kMax}),
              0);
    EXPECT_EQ(
        in_sphere({0, 0, 0}, {kMax, 0, 0}, {0, kMax, 0}, {0, 0, kMax}, {kMax, kMax, kMax - 1}), 1);
}

/// Checks that the cells are the Delaunay tetrahedra of all points; returns their number.
std::size_t check(const std::vector<Vec3i>& points) {
    const std::vector<Tetrahedron> cells = delaunay(points);
    const auto at = [&](int i) { return points[static_cast<std::size_t>(i)]; };
    std::map<std::array<int, 3>, std::vector<int>> facets;  // opposite vertices
    std::set<std::pair<int, int>> edges;
    std::set<int> vertices;
    double volume = 0;
    for (const Tetrahedron& t : cells) {
        EXPECT_EQ(orientation(at(t[0]), at(t[1]), at(t[2]), at(t[3])), 1);
        volume += detail::det3<double, double>(vec_cast<double>(at(t[1]) - at(t[0])),
                                               vec_cast<double>(at(t[2]) - at(t[0])),
                                               vec_cast<double>(at(t[3]) - at(t[0])));
        for (int i = 0; i < 4; ++i) {
            vertices.insert(t[i]);
            std::array<int, 3> facet{};
            for (int k = 0, n = 0; k < 4; ++k)
                if (k != i) facet[static_cast<std::size_t>(n++)] = t[static_cast<std::size_t>(k)];
            std::sort(facet.begin(), facet.end());
            facets[facet].push_back(t[static_cast<std::size_t>(i)]);
            for (int k = 0; k < i; ++k)
                edges.insert(
                    std::minmax(t[static_cast<std::size_t>(i)], t[static_cast<std::size_t>(k)]));
        }
    }
    for (const Tetrahedron& t : cells)
        for (std::size_t i = 0; i < 4; ++i) {
            std::array<int, 3> facet{};
            for (std::size_t k = 0, n = 0; k < 4; ++k)
                if (k != i) facet[n++] = t[k];
            std::sort(facet.begin(), facet.end());
            const auto& opposite = facets[facet];
            EXPECT_LE(opposite.size(), 2u);
            for (const int other : opposite) {
                if (other == t[i]) continue;
                EXPECT_LE(in_sphere(at(t[0]), at(t[1]), at(t[2]), at(t[3]), at(other)), 0);
            }
            // A facet of the hull: no point lies beyond.
            if (opposite.size() == 1)
                for (int p = 0; p < static_cast<int>(points.size()) && points.size() < 600; ++p) {
                    Tetrahedron beyond = t;
                    beyond[i] = p;
                    EXPECT_GE(
                        orientation(at(beyond[0]), at(beyond[1]), at(beyond[2]), at(beyond[3])), 0);
                }
        }
    // All distinct points are vertices, and the complex is a ball.
    const auto less = [](Vec3i a, Vec3i b) {
        return std::array{a.x, a.y, a.z} < std::array{b.x, b.y, b.z};
    };
    const std::set<Vec3i, decltype(less)> distinct(points.begin(), points.end(), less);
    if (!cells.empty()) {
        EXPECT_EQ(vertices.size(), distinct.size());
        EXPECT_EQ(static_cast<long>(vertices.size()) - static_cast<long>(edges.size()) +
                      static_cast<long>(facets.size()) - static_cast<long>(cells.size()),
                  1);
    }
    return cells.size();
}

TEST(Delaunay, RandomPoints) {
    std::vector<Vec3i> points;
    for (int i = 0; i < 3000; ++i) points.push_back(random_point(1, i));
    const std::size_t cells = check(points);
    EXPECT_GT(cells, 18000u);  // about 6.77 per point, fewer at the hull
    EXPECT_LT(cells, 20400u);
    points.resize(500);  // includes the test of the whole hull
    check(points);
    // The result is the same again, and for any order of the points.
    const auto coordinates = [](const std::vector<Vec3i>& p) {
        std::set<std::set<std::array<int, 3>>> all;
        for (const Tetrahedron& t : delaunay(p)) {
            std::set<std::array<int, 3>> one;
            for (const int i : t) {
                const Vec3i q = p[static_cast<std::size_t>(i)];
                one.insert({q.x, q.y, q.z});
            }
            all.insert(one);
        }
        return all;
    };
    std::vector<Vec3i> turned(points.rbegin(), points.rend());
    EXPECT_EQ(coordinates(points), coordinates(turned));
}

TEST(Delaunay, LatticesWhereEveryCubeIsCospherical) {
    for (const int n : {2, 3, 6})
        for (const int step : {1, kMax / n}) {
            std::vector<Vec3i> points;
            for (int i = 0; i < n * n * n; ++i)
                points.push_back({i % n * step, i / n % n * step, i / n / n * step});
            const std::size_t cells = check(points),
                              cubes = static_cast<std::size_t>((n - 1) * (n - 1) * (n - 1));
            EXPECT_GE(cells, 5 * cubes);
            EXPECT_LE(cells, 6 * cubes);
        }
}

TEST(Delaunay, PointsOnOneSphere) {
    // Integer points exactly on a sphere: (x, y, z) with x^2 + y^2 + z^2 = 5^2 13^2, in all signs
    // and orders.
    std::vector<Vec3i> points;
    for (int x = -65; x <= 65; ++x)
        for (int y = -65; y <= 65; ++y)
            for (int z = -65; z <= 65; ++z)
                if (x * x + y * y + z * z == 65 * 65) points.push_back({x + 65, y + 65, z + 65});
    ASSERT_GT(points.size(), 300u);
    check(points);
    points.push_back({65, 65, 65});
    check(points);
}

TEST(Delaunay, ThinShellsAsPivotsMakeThem) {
    std::vector<Vec3i> points;
    for (int i = 0; i < 2000; ++i) {
        const Vec3f n = normalize(normal3(draw(2, i)));
        for (const float radius : {4e6f, 4e6f + 300})
            points.push_back(vec_cast<int>(radius * n + Vec3f{8e6f, 8e6f, 8e6f}));
    }
    for (const int x : {0, kMax})
        for (const int y : {0, kMax})
            for (const int z : {0, kMax}) points.push_back({x, y, z});
    check(points);
}

TEST(Delaunay, PlanesOfPointsAndRepetitions) {
    // A plane with one point beside it; points on lines and on facets of the hull.
    std::vector<Vec3i> points;
    for (int i = 0; i < 400; ++i) points.push_back({i % 20, i / 20, 0});
    EXPECT_EQ(check(points), 0u);  // all in one plane
    points.push_back({3, 4, 9});
    const std::size_t cells = check(points);
    EXPECT_EQ(cells, 2u * 19 * 19);  // one over each triangle of the plane
    const std::size_t before = points.size();
    for (std::size_t i = 0; i < before; ++i) points.push_back(points[i]);
    EXPECT_EQ(check(points), cells);
    for (const Tetrahedron& t : delaunay(points))
        for (const int v : t) EXPECT_LT(v, static_cast<int>(before)) << "the first of equal points";
    std::vector<Vec3i> line;
    for (int i = 0; i < 50; ++i) line.push_back({i, 2 * i, 3 * i});
    EXPECT_EQ(check(line), 0u);
    line.push_back({5, 0, 0});
    EXPECT_EQ(check(line), 0u);
    line.push_back({0, 7, 1});
    EXPECT_EQ(check(line), 49u);
}

TEST(Delaunay, FewPoints) {
    std::vector<Vec3i> points;
    EXPECT_EQ(check(points), 0u);
    for (const Vec3i p : {Vec3i{1, 1, 1}, {5, 1, 1}, {1, 5, 1}, {1, 1, 5}}) {
        EXPECT_EQ(check(points), 0u);
        points.push_back(p);
    }
    EXPECT_EQ(check(points), 1u);
    points.push_back({2, 2, 2});
    EXPECT_EQ(check(points), 4u);
    EXPECT_EQ(check(std::vector<Vec3i>(100, Vec3i{7, 8, 9})), 0u);
}

}  // namespace
}  // namespace tvsgs
