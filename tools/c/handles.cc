// SPDX-License-Identifier: Apache-2.0
#include "tools/c/internal/handles.h"

#include <algorithm>
#include <cmath>

#include "store/base/out_of_memory.h"
#include "store/base/redact.h"

namespace mtdb::internal {

void SetMessage(mtdb_error* error, const std::string& text) {
  if (error == nullptr) return;
  std::string message;
  if (!TryAllocate([&] { message = WithoutSecrets(text); })) message = "out of memory";
  size_t size = std::min(message.size(), sizeof(error->message) - 1);
  const auto continues = [&](size_t at) {
    return at < message.size() && (static_cast<unsigned char>(message[at]) & 0xc0) == 0x80;
  };
  while (size > 0 && continues(size)) --size;
  std::memcpy(error->message, message.data(), size);
  error->message[size] = '\0';
}

Status NeedAll(std::initializer_list<std::pair<const void*, const char*>> arguments) {
  for (const auto& [pointer, name] : arguments) {
    if (pointer == nullptr) return InvalidArgument(std::string(name) + ": is NULL");
  }
  return Status::Ok();
}

Status NeedFinite(std::initializer_list<double> numbers, const char* name) {
  for (const double n : numbers) {
    if (!std::isfinite(n)) return InvalidArgument(std::string(name) + ": expected finite numbers");
  }
  return Status::Ok();
}

namespace {

// The size that the caller has set; the first member of all such structs.
Result<size_t> SizeOf(const void* given, const char* name) {
  size_t size = 0;
  std::memcpy(&size, given, sizeof(size));
  if (size < sizeof(size_t) || size > 65536) {
    return InvalidArgument(std::string(name) + ".struct_bytes: expected the struct's size, found " +
                           std::to_string(size) + "; set it by MTDB_INIT");
  }
  return size;
}

}  // namespace

Status TakeBytes(const void* given, const char* name, size_t size, void* taken) {
  if (given == nullptr) return Status::Ok();
  MTDB_ASSIGN_OR_RETURN(const size_t theirs, SizeOf(given, name));
  const auto* bytes = static_cast<const unsigned char*>(given);
  for (size_t i = size; i < theirs; ++i) {
    if (bytes[i] != 0) {
      return Unsupported(std::string(name) +
                         ": has members that this libmtdb does not know; take a newer one");
    }
  }
  std::memcpy(taken, given, std::min(size, theirs));
  return Status::Ok();
}

Status PutBytes(const void* filled, size_t size, const char* name, void* out) {
  MTDB_RETURN_IF_ERROR(NeedAll({{out, name}}));
  MTDB_ASSIGN_OR_RETURN(const size_t theirs, SizeOf(out, name));
  std::memset(out, 0, theirs);
  std::memcpy(out, filled, std::min(size, theirs));
  std::memcpy(out, &theirs, sizeof(theirs));
  return Status::Ok();
}

Status PutAttribute(const AttributeLayout& layout, uint32_t i, mtdb_attribute* attribute) {
  const auto& attributes = layout.attributes;
  if (i >= attributes.size()) {
    return NotFound("attribute " + std::to_string(i) + ": there are " +
                    std::to_string(attributes.size()));
  }
  size_t offset = 0;
  for (size_t k = 0; k < i; ++k) offset += ScalarSize(attributes[k].type);
  return PutStruct(
      mtdb_attribute{0, attributes[i].name.c_str(), static_cast<mtdb_scalar>(attributes[i].type),
                     static_cast<uint32_t>(offset)},
      "attribute", attribute);
}

}  // namespace mtdb::internal
