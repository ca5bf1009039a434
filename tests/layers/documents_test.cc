// SPDX-License-Identifier: Apache-2.0
// What documents and comments say of files, names and numbers is so: the versions, magic numbers
// and limits of the FORMAT documents, tables of files, links, and names in the comments of headers.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "tests/layers/source_text.h"

namespace mtdb::test {
namespace {

// ---- numbers of the FORMAT documents ------------------------------------------------------------

// A number in a document, and the constant that it stands for. In `place` a @ stands for the
// number; `after` is a heading, or the beginning of a line, behind which the place is.
struct Stated {
  std::string document, after, place;
  std::string file, constant;
};
const std::string kStore = "store/FORMAT.md", kCodecs = "codecs/FORMAT.md";
const std::string kKeys = "store/records/keys.h", kPacked = "store/packed/packed_format.cc",
                  kTiles = "store/records/tiles_head.cc";
const std::string kEntry = "store/pages/catalog_entry.h",
                  kUpdate = "codecs/stream/internal/update_coder.h";
const std::string kMeta = "store/pages/meta_page.cc", kLimits = "codecs/cluster/cluster_limits.h";
const std::vector<Stated> kStated{
    {kStore, "## Versions", "| @ | mtdb 0.1.0 |", kEntry, "kStoreVersion"},
    {kStore, "### Superblock", "| 16 | 4 | u32 | version | @ |", kEntry, "kStoreVersion"},
    {kStore, "", "### Superblock (@ bytes)", kEntry, "kSuperblockBytes"},
    {kStore, "Superblock, the value under", "magic; version @;", kEntry, "kStoreVersion"},
    {kStore, "### Object record", "`u16 version` (@)", "store/records/object_record.cc",
     "kRecordVersion"},
    {kStore, "", "| 0x03 | name, 1..@ bytes", kKeys, "kMaxNameBytes"},
    {kStore, "", "data version @.", kMeta, "kDataVersion"},
    {kStore, "", "u32 magic @, u32 version", kMeta, "kMagic"},
    {kStore, "", "u32 magic 0xbeefc0de, u32 version @,", kMeta, "kDataVersion"},
    {kStore, "### Tiles", "| u16 | version | @ |", kTiles, "kVersion"},
    {kStore, "### Tiles", "with at most @ pixels a side", "store/records/texture_tiles.cc",
     "kCoarsestSide"},
    {kStore, "### Tiles", "| 0..@ |", kTiles, "kMostLevels"},
    {kStore, "### Tiles", "| u16 x 2 | side of the squares, margin | @, 4 |",
     "store/texture_tiles.h", "kTileSide"},
    {kStore, "### Tiles", "| u16 x 2 | side of the squares, margin | 504, @ |",
     "store/texture_tiles.h", "kTileMargin"},
    {kStore, "### Header", "| 16 | 4 | u32 | version | @ |", kPacked, "kVersion"},
    {kStore, "### Header", "1..min(file_bytes - 72, @)", "store/packed/packed_format.h",
     "kMaxDirectoryBytes"},
    {kStore, "### Header", "1..min(file_bytes - @, 2^28)", "store/packed/packed_format.h",
     "kPackedHeaderBytes"},
    {kStore, "### Directory", "| varint | rows in a page | 1..@;", kPacked, "kMaxRowsPerPage"},
    {kStore, "### Directory", "| varint | length | 1..@ |", kPacked, "kMaxPageBytes"},
    {kCodecs, "# The update stream", "own: @. A client", kUpdate, "kUpdateVersion"},
    {kCodecs, "# The update stream", "varint length (1 .. @)", kUpdate, "kMaxRecordBytes"},
    {kCodecs, "Limits: a cluster", "at most @ slots, 65,535 local", kLimits, "kMostSlots"},
    {kCodecs, "Limits: a cluster", "slots, @ local vertices", kLimits, "kMostSlots"},
    {kCodecs, "Limits: a cluster", "rings, @ nodes", kLimits, "kMostNodes"},
    {kCodecs, "Limits: a cluster", "nodes and @ children", kLimits, "kMostChildren"},
};
// Likewise what begins a file or stream, as it is written.
const std::vector<Stated> kMagics{
    {kStore, "### Tiles", "| 4 bytes | magic | `@` |", kTiles, "kMagic"},
    {kStore, "### Superblock", "| magic | `@` and six zero bytes |", "store/pages/catalog_entry.cc",
     "kMagic"},
    {kStore, "### Header", "| magic | `@` and five zero bytes |", kPacked, "kMagic"},
    {kCodecs, "# The update stream", "stream := \"@\", u8 version", kUpdate, "kUpdateMagic"},
};

std::string TextBehind(const std::string& text, const std::string& after) {
  if (after.empty()) return text;
  for (size_t at = text.find(after); at != std::string::npos; at = text.find(after, at + 1)) {
    if (at == 0 || text[at - 1] == '\n') return text.substr(at);
  }
  return "";
}

// What stands at the @ of the first place; none when there is no such place.
std::optional<std::string> TextAt(const std::string& text, const Stated& stated,
                                  const std::string& characters) {
  const std::string behind = TextBehind(text, stated.after);
  const size_t gap = stated.place.find('@');
  const std::string left = stated.place.substr(0, gap), right = stated.place.substr(gap + 1);
  for (size_t at = behind.find(left); at != std::string::npos; at = behind.find(left, at + 1)) {
    const size_t begin = at + left.size();
    size_t end = behind.find_first_not_of(characters, begin);
    if (end == std::string::npos) end = behind.size();
    while (end > begin && behind[end - 1] == ',') --end;  // of the sentence
    if (end > begin && behind.compare(end, right.size(), right) == 0) {
      return behind.substr(begin, end - begin);
    }
  }
  return std::nullopt;
}

// 2, 0xbeefc0de, 2^28, 65,535, 64 << 10, uint64_t{1} << 28.
double NumberOf(std::string text) {
  std::string plain;
  for (const auto& part : Matches(text, "uint[0-9]+_t\\{([0-9]+)\\}|([0-9a-fx<^' ]+)")) {
    plain += part[1].empty() ? part[2] : part[1];
  }
  std::erase_if(plain, [](char c) { return c == '\'' || c == ' '; });
  const size_t power = plain.find('^'), shift = plain.find("<<");
  if (power != std::string::npos) {
    return std::pow(std::stod(plain.substr(0, power)), std::stod(plain.substr(power + 1)));
  }
  if (shift != std::string::npos) {
    return std::ldexp(std::stod(plain.substr(0, shift)), std::stoi(plain.substr(shift + 2)));
  }
  return static_cast<double>(std::stoull(plain, nullptr, 0));
}

// What follows the constant's "=" or "{", up to its ";".
std::string ValueOf(const Texts& texts, const Stated& stated) {
  const auto file = texts.find(stated.file);
  if (file == texts.end()) return "";
  for (const auto& found :
       Matches(Separate(file->second).code, "[ &]" + stated.constant + "( =|\\{)([^;]*);")) {
    return Trimmed(found[2]);
  }
  return "";
}

Violations FalseNumbers(const Texts& texts) {
  Violations found;
  const auto document = [&](const Stated& s) {
    const auto text = texts.find(s.document);
    return text == texts.end() ? std::string() : text->second;
  };
  for (const Stated& s : kStated) {
    std::optional<std::string> stated = TextAt(document(s), s, "0123456789abcdefx^,");
    const std::string value = ValueOf(texts, s);
    if (!stated || value.empty()) {
      found.push_back(s.document + ": " + s.place + ": not there, or no " + s.constant + " in " +
                      s.file);
      continue;
    }
    std::erase(*stated, ',');
    if (NumberOf(*stated) != NumberOf(value)) {
      found.push_back(s.document + ": " + s.place + ": has " + *stated + ", but " + s.constant +
                      " is " + value);
    }
  }
  for (const Stated& s : kMagics) {
    const std::optional<std::string> stated =
        TextAt(document(s), s, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ ");
    const std::string value = ValueOf(texts, s);
    std::string letters;  // "mtdb" or 'm', 't', 'd', 'b'
    for (const auto& part : Matches(value, "'(.)'")) letters += part[1];
    for (const auto& part : Matches(value, "\"([A-Za-z ]+)")) letters += part[1];
    if (!stated || *stated != letters) {
      found.push_back(s.document + ": " + s.place + ": is not '" + letters + "'");
    }
  }
  return found;
}

// Rows of tables that state a version or a magic number, and all that the tables above do not know.
size_t StatedRows(const Texts& texts, const std::string& word) {
  size_t rows = 0;
  for (const std::string& document : {kStore, kCodecs}) {
    for (const std::string& line : LinesOf(texts.at(document))) {
      if (line.starts_with("|") && line.find("| " + word + " |") != std::string::npos &&
          !line.starts_with("| " + word)) {
        ++rows;
      }
    }
  }
  return rows;
}

TEST_CASE("the FORMAT documents have the versions, magic numbers and limits of the code",
          "[layers][documents]") {
  const Texts& texts = ProjectTexts();
  for (const std::string& violation : FalseNumbers(texts)) FAIL_CHECK(violation);
  const auto in_tables = [](const std::vector<Stated>& stated, const std::string& word) {
    return std::ranges::count_if(stated, [&](const Stated& s) {
      return s.place.starts_with("|") && s.place.find("| " + word + " |") != std::string::npos;
    });
  };
  CHECK(StatedRows(texts, "version") == static_cast<size_t>(in_tables(kStated, "version")));
  CHECK(StatedRows(texts, "magic") == static_cast<size_t>(in_tables(kMagics, "magic")));
  // Each of them is looked at: any other number is found.
  for (const std::vector<Stated>* const all : {&kStated, &kMagics}) {
    for (const Stated& s : *all) {
      Texts wrong = texts;
      const std::string& text = texts.at(s.document);
      const std::string behind = TextBehind(text, s.after);
      const size_t gap = s.place.find('@');
      const std::string left = s.place.substr(0, gap);
      const bool number = all == &kStated;
      const auto right =
          TextAt(text, s, number ? "0123456789abcdefx^," : "abcdefghijklmnopqrstuvwxyzLMTUS ");
      INFO(s.document << ": " << s.place);
      REQUIRE(right);
      const size_t at = text.size() - behind.size() +
                        behind.find(left + *right + s.place.substr(gap + 1)) + left.size();
      wrong[s.document].replace(at, right->size(), !number ? "mtdx" : *right == "7" ? "8" : "7");
      CHECK(!FalseNumbers(wrong).empty());
    }
  }
}

// ---- tables of files ----------------------------------------------------------------------------

std::string FolderOf(const std::string& path) {
  const size_t slash = path.rfind('/');
  return slash == std::string::npos ? "" : path.substr(0, slash);
}
std::string NameOf(const std::string& path) { return path.substr(path.rfind('/') + 1); }
std::string Joined(const std::string& folder, const std::string& path) {
  return (std::filesystem::path(folder) / path).lexically_normal().generic_string();
}

// The README that has to tell of a file: that of its folder, or of one around it.
std::string ReadmeOf(const Texts& texts, const std::string& file) {
  for (std::string folder = FolderOf(file); !folder.empty(); folder = FolderOf(folder)) {
    if (texts.contains(folder + "/README.md")) return folder + "/README.md";
  }
  return "README.md";
}

const std::string kFileName =
    "[A-Za-z0-9_./-]+\\.(?:json|page|cmake|hpp|mjs|in|ts|py|cc|h|c|md|map)\\b";

// What the tables of files of a README name in their first column, as written.
std::vector<std::string> Tabled(const std::string& readme) {
  std::vector<std::string> names;
  bool of_files = false;
  std::string before;
  for (const std::string& line : LinesOf(readme)) {
    if (line.starts_with("|---")) {
      const std::string title = Trimmed(before.substr(1, before.find('|', 1) - 1));
      of_files = title == "file" || title == "program";
    } else if (!line.starts_with("|")) {
      of_files = false;
    } else if (of_files && !before.starts_with("| file |")) {
      // Of links the text.
      const std::string cell = std::regex_replace(line.substr(1, line.find('|', 1) - 1),
                                                  std::regex("\\]\\([^)]*\\)"), "]");
      for (const auto& name : Matches(cell, kFileName)) names.push_back(name[0]);
    }
    before = line;
  }
  return names;
}

Violations FalseTables(const Texts& texts) {
  Violations found;
  std::map<std::string, std::set<std::string>> told;  // README -> files
  std::map<std::string, bool> has_table;
  for (const auto& [path, text] : texts) {
    if (NameOf(path) != "README.md") continue;
    std::string last;  // "internal/x.h, y.h" has both in internal/
    for (const std::string& name : Tabled(text)) {
      has_table[path] = true;
      const std::string folder = FolderOf(path);
      std::string file = Joined(folder, name);
      if (!texts.contains(file)) file = Joined(Joined(folder, last), name);
      if (!texts.contains(file)) file = Joined(folder, "internal/" + name);
      if (!texts.contains(file)) file = Joined(folder, "src/" + name);
      if (!texts.contains(file)) {
        found.push_back(path + ": " + name + " is not there");
        continue;
      }
      last = FolderOf(name);
      if (!told[path].insert(file).second)
        found.push_back(path + ": " + name + " stands there twice");
    }
  }
  // Each header, and each file of the other languages, has a row.
  for (const auto& [path, text] : texts) {
    const bool counts = path.ends_with(".h") || path.ends_with(".ts") || path.ends_with(".py");
    if (!counts || path.starts_with("tests/") || FolderOf(path).empty()) continue;
    const std::string readme = ReadmeOf(texts, path);
    if (has_table[readme] && !told[readme].contains(path)) {
      found.push_back(readme + ": " + path + " is not in its table");
    }
  }
  return found;
}

TEST_CASE("the tables of the READMEs name each file that is there, once, and no other",
          "[layers][documents]") {
  for (const std::string& violation : FalseTables(ProjectTexts())) FAIL_CHECK(violation);
  for (const auto& [path, text] : ProjectTexts()) {
    // A formatter of C++ once made one paragraph of a page; its table was gone then.
    if (NameOf(path) != "README.md") continue;
    INFO(path);
    CHECK(text.starts_with("# "));
  }
  const Texts good{{"a/README.md", "| file | idea |\n|---|---|\n| x.h, `internal/y.h` | both |\n"},
                   {"a/x.h", ""},
                   {"a/internal/y.h", ""}};
  CHECK(FalseTables(good).empty());
  Texts twice = good, gone = good, missing = good;
  twice["a/README.md"] += "| x.h | once more |\n";
  gone.erase("a/x.h");
  missing["a/internal/z.h"] = "";
  CHECK(FalseTables(twice) == Violations{"a/README.md: x.h stands there twice"});
  CHECK(FalseTables(gone) == Violations{"a/README.md: x.h is not there"});
  CHECK(FalseTables(missing) == Violations{"a/README.md: a/internal/z.h is not in its table"});
}

// ---- links --------------------------------------------------------------------------------------

// As web pages of a repository name headings.
std::string AnchorOf(const std::string& heading) {
  std::string anchor;
  for (const char c : heading) {
    const auto u = static_cast<unsigned char>(c);
    if (std::isalnum(u) || c == '-' || c == '_' || u >= 0x80)
      anchor += static_cast<char>(std::tolower(u));
    if (c == ' ') anchor += '-';
  }
  return anchor;
}

bool HasAnchor(const std::string& text, const std::string& anchor) {
  for (const std::string& line : LinesOf(text)) {
    const size_t name = line.find_first_not_of('#');
    if (name != 0 && name != std::string::npos && line[name] == ' ' &&
        AnchorOf(line.substr(name + 1)) == anchor) {
      return true;
    }
  }
  return false;
}

Violations FalseLinks(const Texts& texts) {
  std::set<std::string> folders;
  for (const auto& [path, text] : texts) {
    for (std::string f = FolderOf(path); !f.empty(); f = FolderOf(f)) folders.insert(f);
  }
  Violations found;
  for (const auto& [path, text] : texts) {
    if (!path.ends_with(".md")) continue;
    bool verbatim = false;
    for (const std::string& line : LinesOf(text)) {
      if (line.starts_with("```")) verbatim = !verbatim;
      if (verbatim) continue;
      for (const auto& link : Matches(line, "\\]\\(([^)# :]*)(#[^) ]*)?\\)")) {
        std::string target = link[1].empty() ? path : Joined(FolderOf(path), link[1]);
        if (target.ends_with("/")) target.pop_back();
        if (!texts.contains(target) && !folders.contains(target)) {
          found.push_back(path + ": " + link[1] + " is not there");
        } else if (!link[2].empty() && target.ends_with(".md") &&
                   !HasAnchor(texts.at(target), link[2].substr(1))) {
          found.push_back(path + ": " + link[1] + link[2] + ": no such heading");
        }
      }
    }
  }
  return found;
}

TEST_CASE("links between documents lead somewhere", "[layers][documents]") {
  for (const std::string& violation : FalseLinks(ProjectTexts())) FAIL_CHECK(violation);
  const Texts texts{{"a/b.md",
                     "# One two\n[x](c.md), [y](../d.md#three), [z](#one-two), "
                     "[w](https://x.org/y), [v](../a)\n```\n[u](nowhere)\n```\n"},
                    {"a/c.md", ""},
                    {"d.md", "## Three\n"}};
  CHECK(FalseLinks(texts).empty());
  Texts wrong = texts;
  wrong.erase("a/c.md");
  wrong["d.md"] = "## Four\n";
  CHECK(FalseLinks(wrong) ==
        Violations{"a/b.md: c.md is not there", "a/b.md: ../d.md#three: no such heading"});
}

// ---- names in comments --------------------------------------------------------------------------

// Words that only look like names of the code.
const std::set<std::string> kProse{"WebAssembly", "mtdb_free_", "WebSocket"};

bool LooksLikeName(const std::string& word) {
  if (word.find('_') != std::string::npos) return true;
  const bool constant = word.size() > 2 && word[0] == 'k' && std::isupper(word[1]);
  size_t humps = 0;  // an upper letter before a lower one
  for (size_t i = 0; i + 1 < word.size(); ++i) {
    humps += std::isupper(word[i]) && std::islower(word[i + 1]) ? 1 : 0;
  }
  return constant || (std::isupper(word[0]) && humps >= 2);
}

Violations FalseNames(const Texts& texts, const std::vector<std::string>& headers) {
  std::set<std::string> known, c_names, files;
  for (const auto& [path, text] : texts) {
    files.insert(path);
    files.insert(NameOf(path));
    if (!IsCode(path)) continue;
    for (const auto& word : Matches(Separate(text).code, "[A-Za-z_][A-Za-z_0-9]*")) {
      known.insert(word[0]);
      if (path.starts_with("tools/c/mtdb")) c_names.insert(word[0]);
    }
  }
  Violations found;
  for (const std::string& header : headers) {
    const std::string comments = Separate(texts.at(header)).comments;
    for (const auto& file : Matches(comments, "[A-Za-z0-9_/]+\\.(?:h|cc|c|md)\\b")) {
      // "internal/x.h" lies in the header's own folder.
      if (!files.contains(file[0]) && !files.contains(Joined(FolderOf(header), file[0])))
        found.push_back(header + ": " + file[0] + " is not there");
    }
    for (const auto& word :
         Matches(comments, "[A-Za-z_][A-Za-z_0-9]*(\\(\\)|\\.(?:h|cc|c|md)\\b)?")) {
      if (word[1].starts_with(".")) continue;
      const std::string name = word[0].substr(0, word[0].size() - word[1].size());
      const bool of_c = name.starts_with("mtdb_") || name.starts_with("MTDB_");
      const bool there =
          of_c && header.starts_with("tools/c/") ? c_names.contains(name) : known.contains(name);
      if ((LooksLikeName(name) || word[1] == "()") && !there && !kProse.contains(name) &&
          !files.contains(name + ".h")) {
        found.push_back(header + ": there is no " + name);
      }
    }
  }
  return found;
}

TEST_CASE("names in the comments of installed headers exist", "[layers][documents]") {
  const Texts& texts = ProjectTexts();
  std::vector<std::string> headers;
  for (const std::string& line : LinesOf(texts.at("cmake/installed_headers.txt"))) {
    if (!line.empty()) headers.push_back(line.substr(line.find(' ') + 1));
  }
  CHECK(headers.size() > 20);
  for (const std::string& violation : FalseNames(texts, headers)) FAIL_CHECK(violation);
  const Texts good{{"tools/c/mtdb_x.h",
                    "/* mtdb_go() starts; see b.h, kMost, WholeThing. */\nint mtdb_go(void);"},
                   {"b.h", "const int kMost = 1; struct WholeThing {};"}};
  CHECK(FalseNames(good, {"tools/c/mtdb_x.h"}).empty());
  Texts wrong = good;
  wrong["b.h"] = "";
  wrong["tools/c/mtdb_x.h"] = "/* mtdb_went() starts; see c.h, kMost, WholeThing. */";
  CHECK(FalseNames(wrong, {"tools/c/mtdb_x.h"}).size() == 4);
}

}  // namespace
}  // namespace mtdb::test
