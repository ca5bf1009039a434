// SPDX-License-Identifier: Apache-2.0
// Names of files that lie beside a mesh file: images, and descriptions of materials.
#pragma once

#include <set>
#include <string>
#include <string_view>

namespace mtdb::internal {

// The folder of a file, with the slash behind it; empty for the current one.
std::string FolderOf(std::string_view path);
// What is behind the last slash of either kind.
std::string_view LastPart(std::string_view path);
// The last part of `name` as a name that every system takes: UTF-8 of at most 120 bytes without
// control characters and without those that mean something to a shell or a file system; "texture"
// where nothing is left.
std::string PlainFileName(std::string_view name);

// Where the file is that one in `folder` (FolderOf) names, with slashes of either kind: there, or
// where no file is there, the last part of the name in `folder`. A file that came from elsewhere
// must not make others of this machine part of a mesh: of names that lead out of `folder`, it is
// always the last part.
std::string PathOfNamed(const std::string& folder, std::string_view name);

// Gives names that differ from each other, also on systems for which capital and small letters are
// the same.
class DistinctNames {
 public:
  // `name`, with a number before its suffix where it is taken.
  std::string Add(const std::string& name);

 private:
  std::set<std::string> taken_;  // in small letters
};

}  // namespace mtdb::internal
