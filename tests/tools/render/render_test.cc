// SPDX-License-Identifier: Apache-2.0
#include "tools/render/render.h"

#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <numbers>
#include <png.h>
#include <string>
#include <unistd.h>
#include <utility>
#include <vector>

#include "tests/support/temporary_folder.h"

namespace mtdb {
namespace {

// A sphere of radius 1 around `centre`, from an icosahedron whose triangles are split `level`
// times.
TriangleMesh Icosphere(int level, Vec3d centre = {}) {
  const double g = std::numbers::phi;
  TriangleMesh mesh;
  for (const double s : {1.0, -1.0}) {
    for (const double t : {g, -g}) {
      mesh.positions.push_back({0, s, t});
      mesh.positions.push_back({s, t, 0});
      mesh.positions.push_back({t, 0, s});
    }
  }
  // Neighbours are 2 apart.
  const auto near = [&](uint64_t a, uint64_t b) {
    return std::abs(Length(mesh.positions[a] - mesh.positions[b]) - 2) < 1e-9;
  };
  for (uint64_t a = 0; a < 12; ++a) {
    for (uint64_t b = a + 1; b < 12; ++b) {
      for (uint64_t c = b + 1; c < 12; ++c) {
        if (!near(a, b) || !near(b, c) || !near(a, c)) continue;
        const Vec3d p = mesh.positions[a], q = mesh.positions[b], r = mesh.positions[c];
        const bool outward = Dot(p, Cross(q, r)) > 0;
        mesh.triangles.push_back(outward ? TriangleVertices{a, b, c} : TriangleVertices{a, c, b});
      }
    }
  }
  for (int i = 0; i < level; ++i) {
    std::map<std::pair<uint64_t, uint64_t>, uint64_t> middles;
    const auto middle = [&](uint64_t a, uint64_t b) {
      const auto [at, is_new] = middles.emplace(std::minmax(a, b), mesh.positions.size());
      if (is_new) mesh.positions.push_back((mesh.positions[a] + mesh.positions[b]) * 0.5);
      return at->second;
    };
    std::vector<TriangleVertices> finer;
    for (const auto& [a, b, c] : mesh.triangles) {
      const uint64_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    mesh.triangles = finer;
  }
  for (Vec3d& p : mesh.positions) p = centre + p * (1 / Length(p));
  return mesh;
}

TriangleMesh OneTriangle() {
  TriangleMesh mesh;
  mesh.positions = {{-1, 0, -1}, {1, 0, -1}, {0, 0, 1}};
  mesh.triangles = {{0, 1, 2}};
  return mesh;
}

RenderOptions Small() {
  RenderOptions options;
  options.width = 160;
  options.height = 120;
  return options;
}

RenderImage Render(const TriangleMesh& mesh, const RenderOptions& options) {
  RenderImage image;
  const Status status = RenderMesh(mesh, options, &image);
  INFO(status.message());
  REQUIRE(status.ok());
  return image;
}

int Brightness(const RenderImage& image, int x, int y) {
  const size_t at =
      3 * (static_cast<size_t>(y) * static_cast<size_t>(image.width) + static_cast<size_t>(x));
  return image.rgb[at] + image.rgb[at + 1] + image.rgb[at + 2];
}

// Pixels in which the two pictures differ by more than dither.
size_t DifferentPixels(const RenderImage& a, const RenderImage& b) {
  size_t count = 0;
  for (size_t i = 0; i < a.rgb.size(); i += 3) {
    int most = 0;
    for (size_t c = 0; c < 3; ++c) most = std::max(most, std::abs(a.rgb[i + c] - b.rgb[i + c]));
    count += most > 3;
  }
  return count;
}

TEST_CASE("the outline of a sphere covers a disc") {
  RenderOptions options = Small();
  options.width = options.height = 200;
  // A frame that the camera sees as a square: the depth does not matter.
  options.view_direction = {0, 1, 0};
  const TriangleMesh sphere = Icosphere(5);
  const RenderImage image = Render(sphere, options);
  // The background is that of a picture of next to nothing.
  TriangleMesh speck = Icosphere(0);
  for (Vec3d& p : speck.positions) p = p * 1e-4;
  options.frame = CornersOf({{-1, -1, -1}, {1, 1, 1}});
  const RenderImage background = Render(speck, options);
  const auto covered = static_cast<double>(DifferentPixels(image, background));
  int left = 200, right = -1;
  for (int x = 0; x < 200; ++x) {
    if (std::abs(Brightness(image, x, 100) - Brightness(background, x, 100)) <= 9) continue;
    left = std::min(left, x);
    right = x;
  }
  const double diameter = right - left + 1;
  CHECK(diameter > 160);  // the mesh fills the picture, within a margin
  CHECK(diameter < 196);
  CHECK(covered == Approx(std::numbers::pi / 4 * diameter * diameter).epsilon(0.03));
}

TEST_CASE("a triangle that faces the viewer is brighter than the background") {
  RenderOptions options = Small();
  options.view_direction = {0.1, 1, -0.1};
  const RenderImage image = Render(OneTriangle(), options);
  REQUIRE(image.rgb.size() == 3u * 160 * 120);
  CHECK(Brightness(image, 80, 70) > Brightness(image, 3, 3) + 60);
}

TEST_CASE("a picture does not depend on the mesh's place or on the run") {
  const RenderImage here = Render(Icosphere(2), Small());
  CHECK(DifferentPixels(here, Render(Icosphere(2), Small())) == 0);
  const RenderImage far_off = Render(Icosphere(2, {4.5e6, -5.2e6, 300}), Small());
  CHECK(DifferentPixels(here, far_off) < here.rgb.size() / 3 / 200);
}

TEST_CASE("the wireframe draws lines on large triangles and spares small ones") {
  RenderOptions lines = Small();
  lines.wireframe = true;
  const size_t pixels = size_t{160} * 120;
  const TriangleMesh coarse = Icosphere(1), dense = Icosphere(6);
  const size_t changed = DifferentPixels(Render(coarse, Small()), Render(coarse, lines));
  CHECK(changed > pixels / 100);
  CHECK(changed < pixels / 4);
  CHECK(DifferentPixels(Render(dense, Small()), Render(dense, lines)) < pixels / 100);
}

TEST_CASE("vertex colours colour the picture") {
  TriangleMesh mesh = OneTriangle();
  for (const char* name : {"quality", "red", "green", "blue"}) {
    mesh.header.attributes.attributes.push_back(
        {name, name[0] == 'q' ? ScalarType::kFloat32 : ScalarType::kUint8});
  }
  ByteWriter rows;
  for (int v = 0; v < 3; ++v) {
    rows.Put(1.0f);
    rows.Put(uint8_t{250});
    rows.Put(uint8_t{20});
    rows.Put(uint8_t{20});
  }
  mesh.rows = rows.Take();
  RenderOptions options = Small();
  options.view_direction = {0, 1, 0};
  const RenderImage image = Render(mesh, options);
  const size_t at = 3 * (size_t{70} * 160 + 80);
  CHECK(image.rgb[at] > 2 * image.rgb[at + 1]);
  CHECK(image.rgb[at] > 2 * image.rgb[at + 2]);
}

TEST_CASE("what cannot be drawn is refused with a reason") {
  RenderImage image;
  const auto code = [&image](const TriangleMesh& mesh, const RenderOptions& options) {
    const Status status = RenderMesh(mesh, options, &image);
    CHECK_FALSE(status.message().empty());
    return status.code();
  };
  CHECK(code(TriangleMesh{}, Small()) == StatusCode::kInvalidArgument);
  TriangleMesh broken = OneTriangle();
  broken.triangles[0][1] = 3;
  CHECK(code(broken, Small()) == StatusCode::kInvalidArgument);
  broken = OneTriangle();
  broken.positions[0].x = std::nan("");
  CHECK(code(broken, Small()) == StatusCode::kInvalidArgument);
  RenderOptions options = Small();
  options.width = 0;
  CHECK(code(OneTriangle(), options) == StatusCode::kInvalidArgument);
  options = Small();
  options.view_direction = {0, 0, 0};
  CHECK(code(OneTriangle(), options) == StatusCode::kInvalidArgument);
  options = Small();
  options.frame = {{std::nan(""), 0, 0}};
  CHECK(code(OneTriangle(), options) == StatusCode::kInvalidArgument);
}

TEST_CASE("looking straight down and meshes of no extent are drawn") {
  RenderOptions options = Small();
  options.view_direction = {0, 0, -1};
  Render(Icosphere(1), options);
  TriangleMesh point = OneTriangle();
  for (Vec3d& p : point.positions) p = {5, 5, 5};
  Render(point, options);
}

TEST_CASE("libpng reads back the picture that was written") {
  const testing::TemporaryFolder folder;
  const std::string path = folder.path() + "/a.png";
  const RenderImage image = Render(OneTriangle(), Small());
  REQUIRE(WritePng(path, image).ok());
  CHECK_FALSE(std::filesystem::exists(path + ".part"));
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  REQUIRE(png_image_begin_read_from_file(&png, path.c_str()) != 0);
  CHECK(png.width == 160);
  CHECK(png.height == 120);
  png.format = PNG_FORMAT_RGB;
  std::vector<uint8_t> back(PNG_IMAGE_SIZE(png));
  REQUIRE(png_image_finish_read(&png, nullptr, back.data(), 0, nullptr) != 0);
  CHECK(back == image.rgb);
}

TEST_CASE("a picture that cannot be written names its path") {
  const RenderImage image{1, 1, {1, 2, 3}, {}, {}};
  const Status status = WritePng("/no/such/folder/a.png", image);
  CHECK(status.code() == StatusCode::kIoError);
  CHECK(status.message().find("/no/such/folder/a.png") != std::string::npos);
}

}  // namespace
}  // namespace mtdb
