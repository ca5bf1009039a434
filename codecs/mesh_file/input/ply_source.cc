// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/input/ply_source.h"

#include <cmath>
#include <limits>
#include <string_view>

namespace mtdb::internal {
namespace {

template <typename T>
bool SetInteger(int64_t v, PlyValue* value) {
  if (v < std::numeric_limits<T>::min() || v > std::numeric_limits<T>::max()) return false;
  value->Set(static_cast<T>(v));
  return true;
}

bool SetInteger(ScalarType type, int64_t v, PlyValue* value) {
  switch (type) {
    case ScalarType::kInt8: return SetInteger<int8_t>(v, value);
    case ScalarType::kUint8: return SetInteger<uint8_t>(v, value);
    case ScalarType::kInt16: return SetInteger<int16_t>(v, value);
    case ScalarType::kUint16: return SetInteger<uint16_t>(v, value);
    case ScalarType::kInt32: return SetInteger<int32_t>(v, value);
    default: return SetInteger<uint32_t>(v, value);
  }
}

const char* Expected(ScalarType type) {
  switch (type) {
    case ScalarType::kInt8: return "an integer from -128 to 127";
    case ScalarType::kUint8: return "an integer from 0 to 255";
    case ScalarType::kInt16: return "an integer from -32768 to 32767";
    case ScalarType::kUint16: return "an integer from 0 to 65535";
    case ScalarType::kInt32: return "an integer of 32 bits";
    case ScalarType::kUint32: return "an integer from 0 to 4294967295";
    case ScalarType::kFloat32:
    case ScalarType::kFloat64: break;
  }
  return "a number";
}

bool Parse(std::string_view token, ScalarType type, PlyValue* value) {
  if (type == ScalarType::kFloat32) {
    float v = 0;
    if (!ParseReal(token, &v)) return false;
    value->Set(v);
    return true;
  }
  if (type == ScalarType::kFloat64) {
    double v = 0;
    if (!ParseReal(token, &v)) return false;
    value->Set(v);
    return true;
  }
  int64_t v = 0;
  if (ParseInteger(token, &v)) return SetInteger(type, v, value);
  // Some writers print integers as "255.0".
  double real = 0;
  if (!ParseReal(token, &real) || real != std::floor(real) || std::abs(real) > 4294967295.0) {
    return false;
  }
  return SetInteger(type, static_cast<int64_t>(real), value);
}

}  // namespace

bool PlyTextSource::Get(ScalarType type, PlyValue* value) {
  std::string_view token;
  if (!reader_.NextToken(&token)) {
    problem_ = std::string("expected ") + Expected(type) +
               ", found the end of the file; the file is cut short";
    return false;
  }
  if (first_line_ == 0) first_line_ = reader_.line();
  if (Parse(token, type, value)) return true;
  problem_ = std::string("expected ") + Expected(type) + ", found " + Quoted(token);
  return false;
}

void PlyTextSource::EndInstance() {
  if (first_line_ == 0) return;
  const uint64_t line = reader_.line();
  if (doubtful_line_ == 0 && first_line_ == before_line_ && line != first_line_) {
    doubtful_line_ = first_line_;
  }
  before_line_ = line;
  first_line_ = 0;
}

bool PlyTextSource::NumberFollows() {
  std::string_view token;
  double value = 0;
  if (!reader_.NextToken(&token) || !ParseReal(token, &value)) return false;
  problem_ = "line " + std::to_string(reader_.line()) +
             ": numbers are left over behind the last element, beginning with " + Quoted(token);
  return true;
}

bool PlyTextSource::Skip(ScalarType type, uint64_t count) {
  PlyValue value;
  for (; count > 0; --count) {
    if (!Get(type, &value)) return false;
  }
  return true;
}

}  // namespace mtdb::internal
