// SPDX-License-Identifier: Apache-2.0
#include "codecs/cluster/root_codec.h"

#include <catch2/catch.hpp>
#include <random>

namespace mtdb {
namespace {

Cluster MakePiece(const AttributeLayout& attributes) {
  std::mt19937 random(4);
  Cluster piece;
  for (uint32_t t = 0; t < 100; ++t) {
    if (t == 0)
      piece.in.triangles.push_back({0, 1, 2});
    else
      piece.in.triangles.push_back({t, t + 1, t + 2});
    piece.removers.push_back(t % 3 == 0 ? kDrain : kChildFlag | t % 2);
    if (t % 10 == 1 && t % 3 != 0)
      piece.explicit_arcs.push_back({t, t * 7, static_cast<uint8_t>(t % 3)});
  }
  for (uint32_t v = 0; v < 102; ++v) {
    piece.in.positions.push_back(
        {static_cast<int32_t>(random()), static_cast<int32_t>(10 * v), -5});
    piece.in.vertices.push_back(v * 3 % 200);
    for (size_t i = 0; i < attributes.row_bytes(); ++i) {
      piece.in.rows.push_back(static_cast<std::byte>(random()));
    }
  }
  piece.children = {4, 9};
  return piece;
}

TEST_CASE("a root piece comes back as it was") {
  for (const AttributeLayout& layout :
       {AttributeLayout{},
        AttributeLayout{{{"q", ScalarType::kFloat32}, {"i", ScalarType::kInt8}}}}) {
    const Cluster piece = MakePiece(layout);
    const Bytes payload = EncodeRootPiece(piece, layout);
    const Result<Cluster> back = DecodeRootPiece(payload, layout, 200, "test");
    REQUIRE(back.ok());
    REQUIRE(back->in.triangles == piece.in.triangles);
    REQUIRE(back->in.positions == piece.in.positions);
    REQUIRE(back->in.vertices == piece.in.vertices);
    REQUIRE(back->in.rows == piece.in.rows);
    REQUIRE(back->removers == piece.removers);
    REQUIRE(back->children == piece.children);
    REQUIRE(back->explicit_arcs == piece.explicit_arcs);
    REQUIRE(EncodeRootPiece(*back, layout) == payload);
    REQUIRE_FALSE(DecodeRootPiece(payload, layout, 150, "test").ok());
  }
}

TEST_CASE("a root piece with a vertex twice, in a triangle or in its list, is refused") {
  const auto decodes = [](const auto& change) {
    Cluster piece = MakePiece({});
    change(piece);
    const Result<Cluster> back = DecodeRootPiece(EncodeRootPiece(piece, {}), {}, 200, "test");
    REQUIRE((back.ok() || back.status().code() == StatusCode::kCorrupt));
    return back.ok();
  };
  CHECK(decodes([](Cluster&) {}));
  for (size_t c = 0; c < 3; ++c) {
    CHECK_FALSE(
        decodes([&](Cluster& p) { p.in.triangles[50][c] = p.in.triangles[50][(c + 1) % 3]; }));
  }
  CHECK_FALSE(decodes([](Cluster& p) { p.in.vertices[70] = p.in.vertices[3]; }));
}

TEST_CASE("a damaged root piece is refused or read, never a crash") {
  const AttributeLayout layout{{{"q", ScalarType::kUint16}}};
  const Bytes payload = EncodeRootPiece(MakePiece(layout), layout);
  for (size_t n = 0; n < payload.size(); ++n) {
    REQUIRE_FALSE(DecodeRootPiece(ByteSpan(payload).first(n), layout, 200, "test").ok());
  }
  std::mt19937 random(6);
  for (int i = 0; i < 3000; ++i) {
    Bytes bad = payload;
    bad[random() % bad.size()] ^= static_cast<std::byte>(1 + random() % 255);
    const Result<Cluster> piece = DecodeRootPiece(bad, layout, 200, "test");
    if (piece.ok()) REQUIRE(piece->in.positions.size() <= 200);
  }
}

}  // namespace
}  // namespace mtdb
