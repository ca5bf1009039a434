// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/verbs/late_writer.h"

#include <filesystem>

#include "store/object_name.h"

namespace mtdb {

Status LateWriter::Check() const {
  MTDB_RETURN_IF_ERROR(CheckObjectName(name_));
  std::error_code error;
  const std::filesystem::path folder = std::filesystem::absolute(store_, error).parent_path();
  if (!std::filesystem::is_directory(folder, error)) {
    return NotFound(store_ + ": " + folder.string() + " is not a folder; make it first");
  }
  if (!std::filesystem::exists(store_, error) || Database::NothingStored(store_)) {
    return Status::Ok();
  }
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database, Database::Open(store_));
  const Result<ObjectRecord> found = database->Find(name_);
  if (found.ok() && !replace_) {
    return {StatusCode::kAlreadyExists, store_ + ": object " + name_ +
                                            " is there; replace it with --replace, or choose "
                                            "another --name"};
  }
  return found.ok() || found.status().code() == StatusCode::kNotFound ? Status::Ok()
                                                                      : found.status();
}

Status LateWriter::Begin() {
  if (writer_ != nullptr) return Status::Ok();
  MTDB_ASSIGN_OR_RETURN(database_, Database::Open(store_, {.writable = true, .create = true}));
  MTDB_ASSIGN_OR_RETURN(writer_, database_->Create(name_, replace_));
  return Status::Ok();
}

Result<UnitId> LateWriter::Add(const UnitEntry& entry, std::span<const UnitId> children,
                               ByteSpan payload) {
  MTDB_RETURN_IF_ERROR(Begin());
  return writer_->Add(entry, children, payload);
}

Status LateWriter::AddTextureFile(uint32_t file, ByteSpan part) {
  MTDB_RETURN_IF_ERROR(Begin());
  return writer_->AddTextureFile(file, part);
}

Result<ObjectRecord> LateWriter::Publish(const ObjectRecord& record, const BeforePublish& before) {
  MTDB_RETURN_IF_ERROR(Begin());
  return writer_->Publish(record, before);
}

}  // namespace mtdb
