// SPDX-License-Identifier: Apache-2.0
#include "store/base/attribute_layout.h"

#include <catch2/catch.hpp>
#include <cmath>

namespace mtdb {
namespace {

AttributeLayout Mixed() {
  return {{{"id", ScalarType::kUint32},
           {"a b", ScalarType::kInt8},
           {"nx", ScalarType::kFloat32, 0, 10},
           {"ny", ScalarType::kFloat32},
           {"nz", ScalarType::kFloat32},
           {"quality", ScalarType::kFloat64, 0.001},
           {"t", ScalarType::kFloat32, 0x1p-149}}};
}

Bytes Encoded(const AttributeLayout& layout) {
  ByteWriter w;
  PutAttributeLayout(layout, &w);
  return w.Take();
}

TEST_CASE("an attribute layout comes back from its bytes, and what follows is left", "[base]") {
  for (const AttributeLayout& layout : {AttributeLayout{}, Mixed()}) {
    Bytes bytes = Encoded(layout);
    bytes.push_back(std::byte{77});
    ByteReader reader(bytes);
    const auto decoded = GetAttributeLayout(&reader);
    REQUIRE(decoded.ok());
    CHECK(*decoded == layout);
    CHECK(reader.Get<uint8_t>() == 77);
  }
}

TEST_CASE("every prefix of an attribute layout is refused", "[base]") {
  const Bytes bytes = Encoded(Mixed());
  for (size_t size = 0; size < bytes.size(); ++size) {
    ByteReader reader(ByteSpan(bytes).first(size));
    const auto decoded = GetAttributeLayout(&reader);
    REQUIRE(!decoded.ok());
    CHECK(decoded.status().code() == StatusCode::kCorrupt);
  }
}

TEST_CASE("an attribute layout that no codec could use is refused", "[base]") {
  const auto decodes = [](const auto& change) {
    AttributeLayout layout = Mixed();
    change(layout.attributes);
    const Bytes bytes = Encoded(layout);
    ByteReader reader(bytes);
    return GetAttributeLayout(&reader).ok();
  };
  using Attributes = std::vector<VertexAttribute>;
  CHECK(decodes([](Attributes&) {}));
  const auto grow = [](Attributes& a, size_t count) {
    while (a.size() < count) a.push_back({std::to_string(a.size()), ScalarType::kInt8});
  };
  CHECK(decodes([&](Attributes& a) { grow(a, kMaxAttributes); }));
  CHECK_FALSE(decodes([&](Attributes& a) { grow(a, kMaxAttributes + 1); }));
  CHECK_FALSE(decodes([](Attributes& a) { a[0].type = static_cast<ScalarType>(8); }));
  CHECK_FALSE(decodes([](Attributes& a) { a[0].type = static_cast<ScalarType>(0x40); }));
  CHECK_FALSE(decodes([](Attributes& a) { a[0].type = static_cast<ScalarType>(0x10); }));
  CHECK_FALSE(decodes([](Attributes& a) { a[0].step = 1; }));
  CHECK_FALSE(decodes([](Attributes& a) { a[5].step = -1; }));
  CHECK_FALSE(decodes([](Attributes& a) { a[5].step = std::nan(""); }));
  CHECK_FALSE(decodes([](Attributes& a) { a[2].normal_bits = 17; }));
  CHECK_FALSE(decodes([](Attributes& a) { a[3].normal_bits = 10; }));
  CHECK_FALSE(decodes([](Attributes& a) { a.erase(a.begin() + 3); }));
}

}  // namespace
}  // namespace mtdb
