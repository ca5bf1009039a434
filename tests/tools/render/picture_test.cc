// SPDX-License-Identifier: Apache-2.0
// What pictures show, by statistics of the images: orientation, colours at known places, what is
// drawn over them.
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <png.h>
#include <string>
#include <vector>

#include "tests/support/temporary_folder.h"
#include "tools/render/render.h"
#include "tools/render/view.h"

namespace mtdb {
namespace {

// A cone on a closed base around the origin, with its tip at `axis` * 2 and a base of radius 1.
TriangleMesh Cone(Vec3d axis) {
  const Vec3d u = std::fabs(axis.z) > 0.5 ? Vec3d{1, 0, 0} : Vec3d{0, 0, 1};
  const Vec3d v = Cross(axis, u);
  TriangleMesh mesh;
  constexpr uint64_t kSides = 48;
  for (uint64_t i = 0; i < kSides; ++i) {
    const double a = 2 * M_PI * static_cast<double>(i) / kSides;
    mesh.positions.push_back(u * std::cos(a) + v * std::sin(a));
  }
  mesh.positions.push_back(axis * 2.0);
  mesh.positions.push_back({0, 0, 0});
  for (uint64_t i = 0; i < kSides; ++i) {
    const uint64_t next = (i + 1) % kSides;
    mesh.triangles.push_back({i, next, kSides});
    mesh.triangles.push_back({next, i, kSides + 1});
  }
  return mesh;
}

// Heights over a square of side 10; `flip`: listed the wrong way round.
TriangleMesh Terrain(bool flip) {
  TriangleMesh mesh;
  constexpr uint64_t kSide = 30;
  for (uint64_t y = 0; y <= kSide; ++y) {
    for (uint64_t x = 0; x <= kSide; ++x) {
      const auto px = static_cast<double>(x), py = static_cast<double>(y);
      mesh.positions.push_back({px / 3, py / 3, std::sin(px * 0.7) * std::cos(py * 0.5) * 0.5});
    }
  }
  for (uint64_t y = 0; y < kSide; ++y) {
    for (uint64_t x = 0; x < kSide; ++x) {
      const uint64_t a = y * (kSide + 1) + x, b = a + 1, c = a + kSide + 1, d = c + 1;
      mesh.triangles.push_back(flip ? TriangleVertices{a, c, b} : TriangleVertices{a, b, c});
      mesh.triangles.push_back(flip ? TriangleVertices{b, c, d} : TriangleVertices{b, d, c});
    }
  }
  return mesh;
}

// In the plane y = 0, from -1 to 1, seen from the front; each corner has its height as "height".
TriangleMesh Wall() {
  TriangleMesh mesh;
  mesh.positions = {{-1, 0, -1}, {1, 0, -1}, {1, 0, 1}, {-1, 0, 1}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  mesh.header.attributes.attributes = {{"id", ScalarType::kUint16},
                                       {"height", ScalarType::kFloat32}};
  ByteWriter rows;
  for (const Vec3d& p : mesh.positions) {
    rows.Put(uint16_t{7});
    rows.Put(static_cast<float>(p.z));
  }
  mesh.rows = rows.Take();
  return mesh;
}

RenderOptions Plain() {
  RenderOptions options;
  options.width = options.height = 200;
  options.view_direction = {0, 1, 0};
  options.transparent = true;
  options.legend = false;
  return options;
}

RenderImage Render(const TriangleMesh& mesh, const RenderOptions& options) {
  RenderImage image;
  const Status status = RenderMesh(mesh, options, &image);
  INFO(status.message());
  REQUIRE(status.ok());
  return image;
}

size_t At(const RenderImage& image, int x, int y) {
  return static_cast<size_t>(y) * static_cast<size_t>(image.width) + static_cast<size_t>(x);
}
Rgb Pixel(const RenderImage& image, int x, int y) {
  const size_t at = 3 * At(image, x, y);
  return {image.rgb[at], image.rgb[at + 1], image.rgb[at + 2]};
}
// Pixels of the row that show the mesh, of an image with alpha.
int Covered(const RenderImage& image, int y) {
  int count = 0;
  for (int x = 0; x < image.width; ++x) count += image.alpha[At(image, x, y)] > 127;
  return count;
}
int Distance(Rgb a, Rgb b) {
  int most = 0;
  for (size_t c = 0; c < 3; ++c) most = std::max(most, std::abs(int{a[c]} - int{b[c]}));
  return most;
}

TEST_CASE("a cone's tip is up, whatever axis it points along") {
  for (const Vec3d axis : {Vec3d{0, 0, 1}, Vec3d{0, 1, 0}, Vec3d{1, 0, 0}, Vec3d{0, 0, -1},
                           Vec3d{0, -1, 0}, Vec3d{-1, 0, 0}}) {
    CAPTURE(axis.x, axis.y, axis.z);
    const TriangleMesh cone = Cone(axis);
    const Vec3d up = EstimateUp(cone);
    CHECK(Dot(up, axis) == Approx(1));
    for (const char* const view : {"auto", "front", "back", "left", "right", "iso"}) {
      INFO(view);
      RenderOptions options = Plain();
      options.up = up;
      options.view_direction = ViewDirection(view, up, cone.positions);
      const RenderImage image = Render(cone, options);
      int first = -1, last = -1;
      for (int y = 0; y < image.height; ++y) {
        if (Covered(image, y) == 0) continue;
        if (first < 0) first = y;
        last = y;
      }
      // It fills the picture, narrow at the top and broad at the bottom.
      CHECK(last - first > 150);
      const int quarter = (last - first) / 4;
      CHECK(2 * Covered(image, first + quarter) < Covered(image, last - quarter));
    }
  }
}

TEST_CASE("terrain lies, also when its triangles are listed the wrong way round") {
  for (const bool flip : {false, true}) {
    const TriangleMesh terrain = Terrain(flip);
    const Vec3d up = EstimateUp(terrain);
    CHECK(Dot(up, Vec3d{0, 0, 1}) == Approx(1));
    // Seen from so high above that it covers much of the picture.
    RenderOptions options = Plain();
    options.view_direction = ViewDirection("auto", up, terrain.positions);
    const RenderImage image = Render(terrain, options);
    int covered = 0;
    for (int y = 0; y < image.height; ++y) covered += Covered(image, y);
    CHECK(covered > image.width * image.height / 4);
  }
}

TEST_CASE("terrain on a globe has its own up") {
  TriangleMesh terrain = Terrain(false);
  const Vec3d u{0.6, 0, -0.8}, v{0, 1, 0}, up{0.8, 0, 0.6};
  for (Vec3d& p : terrain.positions) p = u * p.x + v * p.y + up * (p.z + 6e6);
  CHECK(Dot(EstimateUp(terrain), up) > 0.99);
}

TEST_CASE("a scan of one side of something is seen from that side, standing") {
  // A bulge as deep as it is wide, which faces z.
  TriangleMesh scan = Terrain(false);
  for (Vec3d& p : scan.positions) {
    const double x = p.x - 5, y = p.y - 5;
    p.z = 5 - 0.12 * (x * x + y * y);
  }
  const Vec3d up = EstimateUp(scan);
  CHECK(Dot(up, Vec3d{0, 1, 0}) == Approx(1));
  CHECK(ViewDirection("auto", up, scan.positions).z < -0.7);
}

TEST_CASE("views look from the sides that they are named after") {
  const std::vector<Vec3d> cube{{0, 0, 0}, {1, 1, 1}};
  const auto is = [&](const char* view, Vec3d up, Vec3d direction) {
    INFO(view);
    CHECK(Length(ViewDirection(view, up, cube) - direction) < 1e-9);
  };
  const Vec3d z{0, 0, 1}, y{0, 1, 0};
  is("front", z, {0, 1, 0});
  is("back", z, {0, -1, 0});
  is("left", z, {1, 0, 0});
  is("right", z, {-1, 0, 0});
  is("top", z, {0, 0, -1});
  is("bottom", z, {0, 0, 1});
  const double third = 1 / std::sqrt(3);
  is("iso", z, {-third, third, -third});
  is("front", y, {0, 0, -1});
  is("left", y, {1, 0, 0});
  is("top", y, {0, -1, 0});
  // The front is below in a view from the top, and above in one from the bottom.
  CHECK(Length(UpOfView({0, 0, -1}, z) - Vec3d{0, 1, 0}) < 1e-9);
  CHECK(Length(UpOfView({0, 0, 1}, z) - Vec3d{0, -1, 0}) < 1e-9);
  // A wall along y is seen from its broad side, and nothing from behind.
  const std::vector<Vec3d> wall{{0, 0, 0}, {1, 9, 3}}, head{{0, 0, 0}, {2, 3, 5}};
  CHECK(ViewDirection("auto", z, wall).x < -0.8);
  CHECK(ViewDirection("auto", z, wall).y > 0.3);
  CHECK(ViewDirection("auto", z, head).y > 0.8);
  CHECK(ViewDirection("auto", y, std::vector<Vec3d>{{0, 0, 0}, {2, 5, 3}}).z < -0.8);
}

TEST_CASE("a background of one colour is just that, and a transparent one is not there") {
  RenderOptions options = Plain();
  const RenderImage clear = Render(Cone({0, 0, 1}), options);
  CHECK(clear.alpha[At(clear, 2, 2)] == 0);
  CHECK(clear.alpha[At(clear, 100, 150)] == 255);
  options.transparent = false;
  options.background = Rgb{10, 200, 30};
  const RenderImage green = Render(Cone({0, 0, 1}), options);
  CHECK(green.alpha.empty());
  size_t as_asked = 0, transparent = 0;
  for (int y = 0; y < 200; ++y) {
    for (int x = 0; x < 200; ++x) {
      if (clear.alpha[At(clear, x, y)] != 0) continue;
      ++transparent;
      as_asked += Pixel(green, x, y) == Rgb{10, 200, 30};
    }
  }
  CHECK(transparent > 10'000);
  CHECK(as_asked == transparent);
}

TEST_CASE("an attribute's values are the legend's colours") {
  RenderOptions options = Plain();
  options.colour = ColourBy::kAttribute;
  options.attribute = "height";
  const RenderImage image = Render(Wall(), options);
  REQUIRE(image.range);
  CHECK((*image.range)[0] == -1);
  CHECK((*image.range)[1] == 1);
  int first = 0, last = 199;
  while (Covered(image, first) == 0) ++first;
  while (Covered(image, last) == 0) --last;
  for (int y = first + 2; y < last - 1; ++y) {
    const double t = 1 - (y + 0.5 - first) / (last + 1 - first);
    const Rgb expected = ColourOfValue(t);
    INFO(y);
    CHECK(Distance(Pixel(image, 100, y), expected) < 10);
    CHECK(Distance(Pixel(image, 60, y), expected) < 10);
  }
  // With a range of its own, what is outside has its ends' colours.
  options.range = std::array{0.0, 2.0};
  const RenderImage half = Render(Wall(), options);
  CHECK(Distance(Pixel(half, 100, 150), ColourOfValue(0)) < 6);
  CHECK(Distance(Pixel(half, 100, first + 2), ColourOfValue(0.5)) < 12);
  options.attribute = "quality";
  RenderImage none;
  const Status status = RenderMesh(Wall(), options, &none);
  CHECK(status.code() == StatusCode::kInvalidArgument);
  CHECK(status.message().find("'quality'") != std::string::npos);
  CHECK(status.message().find("id, height") != std::string::npos);
}

TEST_CASE("normals are colours: what faces the viewer of the front is 127, 0, 127") {
  RenderOptions options = Plain();
  options.colour = ColourBy::kNormal;
  const Rgb shown = Pixel(Render(Wall(), options), 100, 100);
  CHECK(Distance(shown, {127, 0, 127}) < 6);
}

TEST_CASE("colours of the error are distances from the reference") {
  // The reference is a roof: 0.2 behind the wall in the middle, on it at the sides.
  TriangleMesh roof;
  roof.positions = {{-1, 0, -1}, {-1, 0, 1}, {0, 0.2, -1}, {0, 0.2, 1}, {1, 0, -1}, {1, 0, 1}};
  roof.triangles = {{0, 2, 1}, {1, 2, 3}, {2, 4, 3}, {3, 4, 5}};
  RenderOptions options = Plain();
  options.colour = ColourBy::kDistance;
  options.reference = &roof;
  const RenderImage image = Render(Wall(), options);
  const double most = 0.2 / std::sqrt(1 + 0.2 * 0.2);
  REQUIRE(image.range);
  CHECK((*image.range)[0] == 0);
  CHECK((*image.range)[1] == Approx(most).epsilon(0.02));
  CHECK(Distance(Pixel(image, 100, 100), ColourOfValue(1)) < 12);
  CHECK(Distance(Pixel(image, 100 - 44, 100), ColourOfValue(0.5)) < 16);
  const TriangleMesh wall = Wall();
  options.reference = &wall;
  CHECK((*Render(Wall(), options).range)[1] < 1e-6);
}

TEST_CASE("coincident faces that face opposite ways show the front alone, without speckle") {
  TriangleMesh wall = Wall(), twice = Wall();
  wall.rows.clear();
  wall.header.attributes.attributes.clear();
  twice = wall;
  // The back comes first, and is cut along the other diagonal.
  twice.triangles = {{0, 3, 1}, {1, 3, 2}, {0, 1, 2}, {0, 2, 3}};
  for (const Vec3d direction : {Vec3d{0, 1, 0}, Vec3d{-0.42, 0.86, -0.34}, Vec3d{0.3, 0.2, -0.1}}) {
    RenderOptions options = Plain();
    options.view_direction = direction;
    const RenderImage one = Render(wall, options), two = Render(twice, options);
    size_t different = 0;
    for (int y = 0; y < 200; ++y) {
      for (int x = 0; x < 200; ++x) {
        different += Distance(Pixel(one, x, y), Pixel(two, x, y)) > 8;
      }
    }
    CHECK(different == 0);
  }
}

TEST_CASE("the back is bluish and the front is not") {
  const TriangleMesh wall = [] {
    TriangleMesh mesh = Wall();
    mesh.rows.clear();
    mesh.header.attributes.attributes.clear();
    return mesh;
  }();
  RenderOptions options = Plain();
  const Rgb front = Pixel(Render(wall, options), 100, 100);
  options.view_direction = {0, -1, 0};
  const Rgb back = Pixel(Render(wall, options), 100, 100);
  CHECK(front[0] > front[2]);
  CHECK(back[2] > back[0] + 10);
}

TEST_CASE("smooth shading has no steps between the triangles of a cone, and keeps its edge") {
  TriangleMesh cone = Cone({0, 0, 1});
  RenderOptions options = Plain();
  options.draft = true;
  const auto steps = [&](const RenderImage& image) {
    int most = 0;
    for (int x = 30; x < 170; ++x) {
      most = std::max(most, Distance(Pixel(image, x, 170), Pixel(image, x + 1, 170)));
    }
    return most;
  };
  // A coarser cone shows it better.
  std::vector<TriangleVertices> coarse;
  for (uint64_t i = 0; i < 48; i += 6) coarse.push_back({i, (i + 6) % 48, 48});
  cone.triangles = coarse;
  const int flat = steps(Render(cone, options));
  options.smooth = true;
  const int smooth = steps(Render(cone, options));
  CHECK(flat > 20);
  CHECK(smooth < flat / 3);
}

TEST_CASE("a scale bar is as long as it says") {
  RenderOptions options = Plain();
  options.scale_bar = true;
  // The wall is 2 wide, at one depth, and covers this many pixels.
  const RenderImage image = Render(Wall(), options);
  const double wall = Covered(image, 50);
  // Under the wall's margin: the longest run of white.
  int longest = 0;
  for (int y = 180; y < 200; ++y) {
    int run = 0;
    for (int x = 0; x < 200; ++x) {
      run = Pixel(image, x, y) == Rgb{255, 255, 255} ? run + 1 : 0;
      longest = std::max(longest, run);
    }
  }
  CHECK(longest == Approx(0.5 * wall / 2).margin(1.5));
}

TEST_CASE("a legend is drawn at the right, and only when asked for") {
  RenderOptions options = Plain();
  options.colour = ColourBy::kAttribute;
  options.attribute = "height";
  const RenderImage without = Render(Wall(), options);
  options.legend = true;
  const RenderImage with = Render(Wall(), options);
  int different = 0;
  for (int y = 0; y < 200; ++y) {
    for (int x = 0; x < 200; ++x) {
      if (Distance(Pixel(with, x, y), Pixel(without, x, y)) == 0) continue;
      ++different;
      CHECK(x > 140);
    }
  }
  CHECK(different > 500);
  // The bar goes from the last colour to the first.
  CHECK(Distance(Pixel(with, 185, 61), ColourOfValue(1)) < 12);
  CHECK(Distance(Pixel(with, 185, 138), ColourOfValue(0)) < 12);
}

TEST_CASE("a draft shows the same outline") {
  RenderOptions options = Plain();
  const RenderImage fine = Render(Cone({0, 0, 1}), options);
  options.draft = true;
  const RenderImage draft = Render(Cone({0, 0, 1}), options);
  int different = 0;
  for (size_t i = 0; i < fine.alpha.size(); ++i) {
    different += std::abs(int{fine.alpha[i]} - int{draft.alpha[i]}) > 200;
  }
  CHECK(different == 0);
}

TEST_CASE("a transparent picture is a file with alpha") {
  const testing::TemporaryFolder folder;
  const std::string path = folder.path() + "/a.png";
  const RenderImage image = Render(Cone({0, 0, 1}), Plain());
  REQUIRE(WritePng(path, image).ok());
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  REQUIRE(png_image_begin_read_from_file(&png, path.c_str()) != 0);
  CHECK(png.format == PNG_FORMAT_RGBA);
  std::vector<uint8_t> back(PNG_IMAGE_SIZE(png));
  REQUIRE(png_image_finish_read(&png, nullptr, back.data(), 0, nullptr) != 0);
  bool same = true;
  for (size_t i = 0; i < image.alpha.size(); ++i) same = same && back[4 * i + 3] == image.alpha[i];
  CHECK(same);
}

}  // namespace
}  // namespace mtdb
