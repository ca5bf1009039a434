// SPDX-License-Identifier: Apache-2.0
// What Python and TypeScript repeat of the C interface and of the engine in WebAssembly is what
// these have: members, enums, functions with their arguments.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cctype>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "tests/layers/source_text.h"

namespace mtdb::test {
namespace {

using Members = std::vector<std::pair<std::string, std::string>>;  // name, type

// ---- the C headers ------------------------------------------------------------------------------

// What comes between the brace that opens at or behind `at` and the one that closes it.
std::string Braced(const std::string& text, size_t at) {
  const size_t begin = text.find('{', at);
  size_t depth = 0, end = begin;
  for (; end < text.size(); ++end) {
    if (text[end] == '{') ++depth;
    if (text[end] == '}' && --depth == 0) break;
  }
  return text.substr(begin + 1, end - begin - 1);
}

std::vector<std::string> Split(const std::string& text, char separator) {
  std::vector<std::string> parts(1);
  int depth = 0;
  for (const char c : text) {
    depth += c == '(' || c == '[' ? 1 : c == ')' || c == ']' ? -1 : 0;
    if (c == separator && depth == 0)
      parts.emplace_back();
    else
      parts.back() += c;
  }
  std::erase_if(parts, [](const std::string& part) { return Trimmed(part).empty(); });
  return parts;
}

// "mtdb_mesh_view" -> "MeshView".
std::string ClassName(const std::string& c_name) {
  std::string name;
  bool upper = true;
  for (const char c : c_name.substr(5)) {
    if (c != '_') name += upper ? static_cast<char>(std::toupper(c)) : c;
    upper = c == '_';
  }
  return name;
}

// The ctypes type of a declaration without its name; "pointer" for any pointer but a text's.
std::string PythonType(std::string type, const std::set<std::string>& enums) {
  const bool is_written = type.find("const") == std::string::npos;  // through the pointer
  type = Trimmed(std::regex_replace(type, std::regex("\\bconst\\b|\\s+"), " "));
  type = Trimmed(std::regex_replace(type, std::regex(" +"), " "));
  if (type == "char*" || type == "char *") return is_written ? "pointer" : "Text";
  if (type.find('*') != std::string::npos) return "pointer";
  static const std::map<std::string, std::string> kTypes{
      {"size_t", "C.c_size_t"}, {"uint32_t", "C.c_uint32"}, {"uint64_t", "C.c_uint64"},
      {"int", "C.c_int"},       {"double", "C.c_double"},   {"unsigned char", "C.c_ubyte"},
      {"char", "C.c_char"}};
  if (const auto known = kTypes.find(type); known != kTypes.end()) return known->second;
  if (enums.contains(type)) return "C.c_int";
  return type.starts_with("mtdb_") ? ClassName(type) : type;
}

struct Interface {
  std::map<std::string, Members> structs, enums;              // by the C names
  std::map<std::string, std::vector<std::string>> functions;  // types of arguments
};

// "const double* a[3]" -> ("a", "C.c_double * 3").
std::pair<std::string, std::string> MemberOf(const std::string& declaration,
                                             const std::set<std::string>& enums) {
  if (const auto function = Matches(declaration, "\\(\\*([a-z_]+)\\)"); !function.empty()) {
    return {function[0][1], "function"};
  }
  const auto found = Matches(declaration, "^(.*[ *])([a-z_0-9]+)(\\[([0-9]+)\\])?$");
  if (found.empty()) return {declaration, "?"};
  const std::string type = PythonType(found[0][1], enums);
  return {found[0][2], type + (found[0][4].empty() ? "" : " * " + found[0][4])};
}

void AddStruct(const std::string& name, const std::string& body, const std::set<std::string>& enums,
               Interface* found) {
  for (const std::string& declaration : Split(body, ';')) {
    std::string type;
    for (const std::string& one : Split(declaration, ',')) {  // "uint32_t columns, rows"
      const std::string whole = Trimmed(type.empty() ? one : type + " " + Trimmed(one));
      if (type.empty()) type = Trimmed(one.substr(0, one.find_last_of(" *") + 1));
      found->structs[name].push_back(
          MemberOf(std::regex_replace(whole, std::regex("\\s+"), " "), enums));
    }
  }
}

Interface InterfaceOf(const Texts& texts) {
  std::string code;
  for (const auto& [path, text] : texts) {
    if (path.starts_with("tools/c/mtdb") && path.ends_with(".h")) code += Separate(text).code;
  }
  Interface found;
  std::set<std::string> enums;
  for (const auto& e : Matches(code, "typedef enum (mtdb_[a-z]+(_[a-z]+)*) ")) {
    enums.insert(e[1]);
    for (const auto& value :
         Matches(Braced(code, code.find(e[0])), "(MTDB_[A-Z_0-9]+)\\s*=\\s*([0-9]+)")) {
      found.enums[e[1]].emplace_back(value[1], value[2]);
    }
  }
  for (const auto& s : Matches(code, "typedef struct (mtdb_[a-z_]+) \\{")) {
    AddStruct(s[1], Braced(code, code.find(s[0])), enums, &found);
  }
  for (const auto& f : Matches(code, "MTDB_API [a-z_0-9* ]*[ *](mtdb_[a-z_0-9]+)\\(([^;]*)\\);")) {
    auto& arguments = found.functions[f[1]];
    for (const std::string& argument : Split(f[2], ',')) {
      if (Trimmed(argument) == "void") continue;
      std::string one = std::regex_replace(Trimmed(argument), std::regex("\\s+"), " ");
      // An array is a pointer here.
      if (one.ends_with("]")) one = "void* " + one.substr(0, one.find('['));
      if (one.starts_with("mtdb_receive ")) one = "int (*receive)";
      arguments.push_back(MemberOf(one, enums).second);
    }
  }
  return found;
}

// The rules at the beginning of mtdb.h: structs begin with their size, but for the room for a text;
// functions with a verb, which is not the name of what they work on.
Violations FalseForms(const Interface& c) {
  Violations wrong;
  for (const auto& [name, members] : c.structs) {
    const bool sized = members.front().first == "struct_bytes";
    if (sized == (name == "mtdb_error")) wrong.push_back(name + ": begins without its size");
  }
  static const std::set<std::string> kNouns{
      "database", "object", "query",   "cut",   "mesh",    "control", "session", "client", "server",
      "texts",    "json",   "profile", "store", "terrain", "heights", "raster",  "closest"};
  for (const auto& [name, arguments] : c.functions) {
    const std::string first = name.substr(5, name.find('_', 5) - 5);
    if (kNouns.contains(first)) wrong.push_back(name + ": begins with a noun");
  }
  return wrong;
}

// ---- Python -------------------------------------------------------------------------------------

// Structs that Python has no use for.
const std::set<std::string> kNotInPython{"mtdb_arrays", "mtdb_sink", "mtdb_progress",
                                         "mtdb_client_options"};

bool SameType(const std::string& python, const std::string& c) {
  if (c == "pointer")
    return python == "Pointer" || python == "_p" || python.starts_with("C.POINTER(");
  if (c == "function") return python.ends_with("Function");
  return python == c;
}

Violations FalseStructs(const Interface& c, const std::string& library) {
  std::map<std::string, Members> classes;
  for (const auto& found : Matches(
           library, "class ([A-Za-z]+)\\((?:C\\.Structure|Struct|Sized)\\):\\s+_fields_ = \\[")) {
    const size_t begin = library.find(found[0]);
    const size_t open = library.find('[', begin);
    std::string body = library.substr(open + 1, library.find("]\n", open) - open - 1);
    for (const auto& field : Matches(
             body, "\\(\"([a-z_0-9]+)\", ([A-Za-z_.0-9]+(\\([A-Za-z]+\\))?( \\* [0-9]+)?)\\)")) {
      classes[found[1]].emplace_back(field[1], field[2]);
    }
  }
  Violations wrong;
  for (const auto& [name, members] : c.structs) {
    if (kNotInPython.contains(name)) continue;
    const Members& theirs = classes[ClassName(name)];
    for (size_t i = 0; i < std::max(members.size(), theirs.size()); ++i) {
      const auto ours = i < members.size() ? members[i] : std::pair<std::string, std::string>();
      const auto python = i < theirs.size() ? theirs[i] : std::pair<std::string, std::string>();
      if (ours.first == python.first && SameType(python.second, ours.second)) continue;
      wrong.push_back(name + ", member " + std::to_string(i) + ": " + ours.first + " (" +
                      ours.second + ") in C, " + python.first + " (" + python.second +
                      ") in Python");
      break;
    }
    classes.erase(ClassName(name));
  }
  for (const auto& [name, members] : classes) wrong.push_back(name + ": is no struct of C");
  return wrong;
}

Violations FalseFunctions(const Interface& c, const std::string& library) {
  const size_t begin = library.find("_SIGNATURES"), others = library.find("_OTHERS");
  const size_t end = library.find("\n}\n", others);
  Violations wrong;
  size_t count = 0;
  const auto hold = [&](const std::string& name, const std::string& list, bool fails) {
    ++count;
    const auto found = c.functions.find("mtdb_" + name);
    if (found == c.functions.end()) return wrong.push_back(name + ": is no function of C");
    std::vector<std::string> types = Split(list, ',');
    if (fails) types.emplace_back("_p");  // the error
    bool same = types.size() == found->second.size();
    for (size_t i = 0; same && i < types.size(); ++i)
      same = SameType(Trimmed(types[i]), found->second[i]);
    if (!same) wrong.push_back(name + ": other arguments than in C");
  };
  for (const auto& f :
       Matches(library.substr(begin, others - begin), "    \"([a-z_]+)\": \\[([^\\]]*)\\],")) {
    hold(f[1], f[2], true);
  }
  for (const auto& f : Matches(library.substr(others, end - others),
                               "    \"([a-z_]+)\": \\([^\\[]*\\[([^\\]]*)\\]\\),")) {
    hold(f[1], f[2], false);
  }
  if (count < 50)
    wrong.push_back("only " + std::to_string(count) + " functions were found in Python");
  return wrong;
}

// The quoted words of the first line that begins so.
std::vector<std::string> WordsOf(const std::string& text, const std::string& begin) {
  std::vector<std::string> words;
  const size_t at = text.find("\n" + begin);
  if (at == std::string::npos) return words;
  const std::string line = text.substr(at + 1, text.find('\n', at + 1) - at - 1);
  for (const auto& word : Matches(line, "[\"']([A-Za-z0-9_<]+)[\"']")) words.push_back(word[1]);
  return words;
}

// "MTDB_LIMIT_MISSING" of mtdb_limit -> "missing".
std::vector<std::string> WordsOfEnum(const Members& values, size_t prefix) {
  std::vector<std::string> words;
  for (size_t i = 0; i < values.size(); ++i) {
    std::string word = values[i].first.substr(prefix);
    for (char& c : word) c = static_cast<char>(std::tolower(c));
    words.push_back(values[i].second == std::to_string(i) ? word : "?");
  }
  return words;
}

Violations FalseEnums(const Interface& c, const Texts& texts) {
  Violations wrong;
  const auto compare = [&](const std::string& what, const std::vector<std::string>& ours,
                           const std::vector<std::string>& theirs) {
    if (ours != theirs || ours.empty()) wrong.push_back(what);
  };
  const std::vector<std::string> limits = WordsOfEnum(c.enums.at("mtdb_limit"), 11);
  compare("LIMITS of Python", limits, WordsOf(texts.at("tools/python/mtdb/_mesh.py"), "LIMITS = "));
  compare("kLimits of TypeScript", limits,
          WordsOf(texts.at("tools/web/src/mtdb.ts"), "const kLimits = "));
  compare("Frame.limit of TypeScript", limits,
          WordsOf(texts.at("tools/web/src/mtdb.ts"), "  limit: 'accuracy"));
  compare("LEVELS of Python", WordsOfEnum(c.enums.at("mtdb_verify_level"), 12),
          WordsOf(texts.at("tools/python/mtdb/_database.py"), "LEVELS = "));
  compare("ASKS of Python", WordsOfEnum(c.enums.at("mtdb_asks"), 10),
          WordsOf(texts.at("tools/python/mtdb/_compare.py"), "ASKS = "));
  // int8 -> i1, uint16 -> <u2, float32 -> <f4.
  std::vector<std::string> scalars;
  for (const std::string& word : WordsOfEnum(c.enums.at("mtdb_scalar"), 5)) {
    const int bytes = std::stoi(word.substr(word.find_first_of("0123456789"))) / 8;
    scalars.push_back((bytes > 1 ? "<" : "") + word.substr(0, 1) + std::to_string(bytes));
  }
  compare("_TYPES of Python", scalars,
          WordsOf(texts.at("tools/python/mtdb/_mesh.py"), "_TYPES = "));
  Members codes, python_codes;
  for (const auto& [name, number] : c.enums.at("mtdb_code")) {
    if (name != "MTDB_OK") codes.emplace_back(name.substr(5), number);
  }
  for (const auto& code :
       Matches(texts.at("tools/python/mtdb/_errors.py"), "    ([A-Z_]+) = ([0-9]+)\n")) {
    python_codes.emplace_back(code[1], code[2]);
  }
  if (codes != python_codes) wrong.push_back("Code of Python");
  // TypeScript has words of its own for them, and not all.
  const std::string& web = texts.at("tools/web/src/mtdb.ts");
  for (const auto& code : Matches(web.substr(web.find("kCodes: Record"), 400), " ([0-9]{3}): '")) {
    if (std::ranges::none_of(codes, [&](const auto& known) { return known.second == code[1]; })) {
      wrong.push_back("kCodes of TypeScript: " + code[1]);
    }
  }
  for (const auto& [constant, name] :
       {std::pair("kNotYet", "NOT_YET"), std::pair("kIoError", "IO_ERROR")}) {
    const auto value = Matches(web, std::string(constant) + " = ([0-9]+)");
    const auto known =
        std::ranges::find(codes, std::string(name), [](const auto& code) { return code.first; });
    if (value.empty() || value[0][1] != known->second)
      wrong.push_back(std::string(constant) + " of TypeScript");
  }
  return wrong;
}

TEST_CASE("Python has the structs, functions and enums of the C headers", "[layers][documents]") {
  const Texts& texts = ProjectTexts();
  const Interface c = InterfaceOf(texts);
  CHECK(c.structs.size() > 25);
  CHECK(c.functions.size() > 60);
  for (const std::string& violation : FalseForms(c)) FAIL_CHECK(violation);
  CHECK(c.enums.size() >= 6);
  const std::string& library = texts.at("tools/python/mtdb/_library.py");
  for (const std::string& violation : FalseStructs(c, library)) FAIL_CHECK(violation);
  for (const std::string& violation : FalseFunctions(c, library)) FAIL_CHECK(violation);
  for (const std::string& violation : FalseEnums(c, texts)) FAIL_CHECK(violation);
  const auto abi = Matches(texts.at("tools/c/mtdb.h"), "#define MTDB_ABI_VERSION ([0-9]+)u");
  REQUIRE(abi.size() == 1);
  CHECK(library.find("\nABI_VERSION = " + abi[0][1] + "\n") != std::string::npos);
}

void Replace(std::string* text, const std::string& from, const std::string& to) {
  const size_t at = text->find(from);
  INFO(from);
  REQUIRE(at != std::string::npos);
  text->replace(at, from.size(), to);
}

TEST_CASE("the comparison with the C headers finds what is wrong", "[layers][documents]") {
  const Texts& texts = ProjectTexts();
  const Interface c = InterfaceOf(texts);
  const std::string& right = texts.at("tools/python/mtdb/_library.py");
  const auto structs = [&](const std::string& from, const std::string& to) {
    std::string library = right;
    Replace(&library, from, to);
    return FalseStructs(c, library).size() + FalseFunctions(c, library).size();
  };
  CHECK(structs("        (\"root_triangles\", C.c_uint64),\n", "") == 1);
  CHECK(structs("(\"excess\", C.c_double)", "(\"excess\", C.c_float)") == 1);
  CHECK(structs("(\"weld\", C.c_int)", "(\"welds\", C.c_int)") == 1);
  CHECK(structs("class Sizes(Sized):", "class Sizess(Sized):") == 2);
  CHECK(structs("\"verify\": [_p, C.c_int, _p, _p]", "\"verify\": [_p, C.c_int, _p]") == 1);
  CHECK(structs("\"get_text\": (Text, [_p, C.c_size_t])",
                "\"get_texts\": (Text, [_p, C.c_size_t])") == 1);
  const auto forms = [&](const std::string& from, const std::string& to) {
    Texts wrong = texts;
    Replace(&wrong["tools/c/mtdb.h"], from, to);
    return FalseForms(InterfaceOf(wrong)).size();
  };
  CHECK(forms("mtdb_code mtdb_copy_cut(", "mtdb_code mtdb_cut_copy(") == 1);
  CHECK(forms("typedef struct mtdb_info {\n  size_t struct_bytes;", "typedef struct mtdb_info {") ==
        1);
  const auto enums = [&](const std::string& file, const std::string& from, const std::string& to) {
    Texts wrong = texts;
    Replace(&wrong[file], from, to);
    return FalseEnums(InterfaceOf(wrong), wrong).size();
  };
  CHECK(enums("tools/python/mtdb/_mesh.py", ", \"missing\")", ")") == 1);
  CHECK(enums("tools/web/src/mtdb.ts", "'time', 'missing'] as const", "'time'] as const") == 1);
  CHECK(enums("tools/python/mtdb/_errors.py", "BUSY = 302", "BUSY = 304") == 1);
  CHECK(enums("tools/python/mtdb/_database.py", "LEVELS = (\"fast\", ", "LEVELS = (") == 1);
  CHECK(enums("tools/web/src/mtdb.ts", " 201: 'corrupt'", " 202: 'corrupt'") == 1);
  CHECK(enums("tools/c/mtdb.h", "MTDB_LIMIT_MISSING = 4", "MTDB_LIMIT_MISSING = 5") == 3);
}

// ---- one name for one thing: tools/interfaces.md ------------------------------------------------

using Names = std::set<std::string>;

bool IsIn(const std::string& word, std::initializer_list<const char*> words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

Names NamesInC(const Interface& c) {
  Names names;
  for (const auto& [name, members] : c.structs) {
    for (const auto& [member, type] : members) names.insert(member);
  }
  return names;
}

// Keywords and fields of one file of the package.
void AddNamesInPython(const std::string& text, Names* names) {
  std::string type;
  size_t at = 0;
  for (const std::string& line : LinesOf(text)) {
    const auto begun = Matches(line, "^class ([A-Za-z_]+)");
    if (!begun.empty()) {
      type = begun[0][1];
    } else if (!line.empty() && line.find_first_of(" @)#\"") != 0) {
      type.clear();
    }
    const bool is_public =
        type.empty() || (!type.starts_with("_") && !IsIn(type, {"Ingest", "Packed", "Layout"}));
    const auto field = Matches(line, "^    ([a-z][a-z_]*): ");
    if (!field.empty() && !type.empty() && is_public) names->insert(field[0][1]);
    const auto function = Matches(line, "^(    )?def ([a-z_]+)\\(");
    const size_t open = text.find('(', at);
    at += line.size() + 1;
    if (function.empty() || !is_public) continue;
    const std::string& name = function[0][2];
    const bool wanted =
        function[0][1].empty()
            ? IsIn(name, {"compare", "compare_heights", "open_database", "connect", "fetch",
                          "read_mesh", "png"})
            : !type.empty() && (!name.starts_with("_") || (type == "Mesh" && name == "__init__"));
    if (!wanted) continue;
    size_t end = open;
    for (int depth = 0; end < text.size(); ++end) {
      if (text[end] == '(') ++depth;
      if (text[end] == ')' && --depth == 0) break;
    }
    for (const std::string& argument : Split(text.substr(open + 1, end - open - 1), ',')) {
      const auto word = Matches(Trimmed(argument), "^([a-z_]+)");
      if (!word.empty() && !IsIn(word[0][1], {"self", "cls"})) names->insert(word[0][1]);
    }
  }
}

std::map<std::string, Names> NamesOf(const Texts& texts) {
  std::map<std::string, Names> names;
  names["C"] = NamesInC(InterfaceOf(texts));
  for (const char* const file : {"_compare", "_database", "_session", "_mesh", "_terrain"}) {
    AddNamesInPython(texts.at("tools/python/mtdb/" + std::string(file) + ".py"), &names["Python"]);
  }
  for (const char* const page : {"docs/json.md", "docs/query.md"}) {
    for (const auto& row : Matches(texts.at(page), "\n\\| `([a-z_0-9]+)` \\|"))
      names["JSON"].insert(row[1]);
  }
  bool open = false;
  for (const std::string& line : LinesOf(texts.at("tools/web/src/mtdb.ts"))) {
    if (line.starts_with("export interface ")) open = true;
    if (line == "}") open = false;
    const auto member = Matches(line, "^  (?:readonly )?([a-zA-Z_]+)\\??:");
    if (!open || member.empty()) continue;
    std::string name;  // "maxBytes" -> "max_bytes"
    for (const char c : member[0][1]) {
      if (std::isupper(c)) name += '_';
      name += static_cast<char>(std::tolower(c));
    }
    names["TypeScript"].insert(name);
  }
  for (const auto& [path, text] : texts) {
    const bool declares =
        path.starts_with("tools/cli/") || path == "tools/request/query_options.cc";
    if (!declares || !IsCode(path)) continue;
    for (const auto& option : Matches(Separate(text).code, "\"(-[a-zA-Z],)?(--[a-z][a-z-]*)\""))
      names["command line"].insert(option[2]);
  }
  std::istringstream installed(texts.at("cmake/installed_headers.txt"));
  for (std::string component, header; installed >> component >> header;) {
    if (component == "c") continue;
    for (const auto& word : Matches(Separate(texts.at(header)).code, "[a-z_0-9]+"))
      names["C++"].insert(word[0]);
  }
  return names;
}

// "max_bytes" as a place spells it; of TypeScript as it was taken.
std::string Spelled(const std::string& name, const std::string& place) {
  if (place != "command line") return name;
  std::string option = "--" + name;
  std::replace(option.begin(), option.end(), '_', '-');
  return option;
}

// A value of the command line tells its unit, or that it is a folder; an option that is given once
// for each of a list is a singular.
bool IsShortened(const std::string& option, const std::string& name) {
  const std::string whole = Spelled(name, "command line");
  return std::ranges::any_of(std::array{"-bytes", "-seconds", "-directory", "s"},
                             [&](const char* end) { return option + end == whole; });
}

// Where the table and the places differ.
Violations FalseNames(const std::string& table, const std::map<std::string, Names>& places) {
  Violations wrong;
  std::map<std::string, Names> told;
  std::vector<std::string> head;
  std::string before;
  for (const std::string& line : LinesOf(table)) {
    if (!line.starts_with("| ")) continue;
    std::vector<std::string> cells;
    for (std::string cell; const char c : line.substr(1)) {
      if (c != '|') {
        cell += c;
        continue;
      }
      cells.push_back(Trimmed(cell));
      cell.clear();
    }
    if (head.empty()) {
      head = cells;
      continue;
    }
    const std::string name = cells[0];
    if (cells.size() != head.size()) {
      wrong.push_back(name + ": has other columns");
      continue;
    }
    if (name <= before) wrong.push_back(name + ": stands in a wrong place");
    before = name;
    if (cells[1].empty() || cells.back().empty()) wrong.push_back(name + ": says too little");
    size_t found = 0;
    for (size_t i = 4; i + 1 < head.size(); ++i) {
      if (cells[i].empty()) continue;
      const std::string spelled = cells[i] == "=" ? Spelled(name, head[i]) : cells[i];
      if (head[i] == "command line" && cells[i] != "=" && !IsShortened(spelled, name))
        wrong.push_back(name + ": is " + spelled + " on the command line");
      told[head[i]].insert(spelled);
      found += head[i] != "C++" ? 1 : 0;
      const auto place = places.find(head[i]);
      if (place == places.end() || !place->second.contains(spelled))
        wrong.push_back(name + ": " + head[i] + " has no " + spelled);
    }
    if (found == 0) wrong.push_back(name + ": is nowhere");
  }
  for (const auto& [place, names] : places) {
    if (place == "C++") continue;  // all words of the headers
    for (const std::string& name : names) {
      if (!told[place].contains(name))
        wrong.push_back(place + ": " + name + " is not in the table");
    }
  }
  return wrong;
}

TEST_CASE("tools/interfaces.md has every name that a user meets, and no other",
          "[layers][documents]") {
  const Texts& texts = ProjectTexts();
  const auto places = NamesOf(texts);
  for (const auto& [place, least] :
       {std::pair("C", 130u), std::pair("Python", 90u), std::pair("JSON", 200u),
        std::pair("TypeScript", 40u), std::pair("command line", 90u), std::pair("C++", 500u)}) {
    INFO(place);
    CHECK(places.at(place).size() > least);
  }
  const std::string& table = texts.at("tools/interfaces.md");
  for (const std::string& violation : FalseNames(table, places)) FAIL_CHECK(violation);
  const auto rows = Matches(table, "\n\\| fill \\|[^\n]*");
  REQUIRE(rows.size() == 1);
  const auto planted = [&](const std::string& from, const std::string& to) {
    std::string wrong = table;
    Replace(&wrong, from, to);
    return FalseNames(wrong, places).size();
  };
  CHECK(planted(rows[0][0], "") == 3);  // C, Python and the command line
  CHECK(planted(rows[0][0], rows[0][0] + rows[0][0]) == 1);
  CHECK(planted("\n| fill |", "\n| fill_ |") == 7);
  std::string renamed = rows[0][0];
  renamed.replace(renamed.rfind("| = |"), 5, "| --fills |");
  CHECK(planted(rows[0][0], renamed) == 3);
  for (const auto& [file, from, to] :
       {std::tuple("tools/c/mtdb.h", "int front;", "int front; int rear;"),
        std::tuple("tools/python/mtdb/_database.py", "clip: bool = False", "clips: bool = False"),
        std::tuple("docs/json.md", "| `diagonal` |", "| `diameter` |"),
        std::tuple("docs/query.md", "| `clip` |", "| `cut` |"),
        std::tuple("tools/web/src/mtdb.ts", "  rounding_error: number", "  rounding: number"),
        std::tuple("tools/cli/options.cc", "\"--clip\"", "\"--cut\"")}) {
    Texts wrong = texts;
    Replace(&wrong[file], from, to);
    INFO(file);
    CHECK(!FalseNames(table, NamesOf(wrong)).empty());
  }
}

// ---- the engine in WebAssembly ------------------------------------------------------------------

// By a function's name, the number of its arguments.
std::map<std::string, size_t> ImportedBy(const std::string& typescript) {
  std::map<std::string, size_t> functions;
  const std::string body = Braced(typescript, typescript.find("interface Exports"));
  for (const auto& f : Matches(body, "\n  ([a-z_]+)\\(([^)]*)\\):"))
    functions[f[1]] = Split(f[2], ',').size();
  functions.erase("_initialize");
  return functions;
}
std::map<std::string, size_t> ExportedBy(const std::string& code) {
  std::map<std::string, size_t> functions;
  for (const auto& f :
       Matches(code, "MTDB_EXPORT\\(\"([a-z_]+)\"\\) extern \"C\" [^(]*\\(([^)]*)\\)")) {
    functions[f[1]] = Split(f[2], ',').size();
  }
  return functions;
}

TEST_CASE("TypeScript imports what the modules of WebAssembly export", "[layers][documents]") {
  const Texts& texts = ProjectTexts();
  const std::pair<const char*, const char*> modules[] = {
      {"tools/web/src/mtdb.ts", "tools/web/wasm/engine.cc"},
      {"tools/viewer/src/decoder.ts", "tools/viewer/wasm/decoder.cc"}};
  for (const auto& [page, engine] : modules) {
    INFO(page);
    const auto imported = ImportedBy(texts.at(page));
    CHECK(imported.size() > 10);
    const auto exported = ExportedBy(texts.at(engine));
    for (const auto& [name, arguments] : imported) {
      INFO(name);
      CHECK(exported.contains(name));
      if (exported.contains(name)) CHECK(exported.at(name) == arguments);
    }
  }
  CHECK(ImportedBy("interface Exports {\n  a(b: number): void;\n}") ==
        std::map<std::string, size_t>{{"a", 1}});
  CHECK(ExportedBy("MTDB_EXPORT(\"a\") extern \"C\" void A(int b, int c) {") ==
        std::map<std::string, size_t>{{"a", 2}});
}

}  // namespace
}  // namespace mtdb::test
