// SPDX-License-Identifier: Apache-2.0
// A class is one idea: at most 25 functions, and 15 members, but for those that a list here names
// with their reasons.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cctype>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/layers/source_text.h"

namespace mtdb::test {
namespace {

constexpr size_t kMaxFunctions = 25;
constexpr size_t kMaxMembers = 15;
const std::set<std::string> kFolders{"store", "codecs", "query", "builder", "tools", "bench"};

const std::string kRecord = "a record: values with names, which nothing hides";
const std::string kPhases = "what a phase leaves for the next one, in the order of the phases";

// File and class -> the reason.
const std::map<std::pair<std::string, std::string>, std::string> kLarger{
    // What a caller sets, or is told.
    {{"builder/build_options.h", "BuildOptions"}, kRecord},
    {{"builder/disk/tile.h", "TileResult"}, kRecord},
    {{"builder/holes/hole.h", "Hole"}, kRecord},
    {{"builder/mesh_survey.h", "MeshSurvey"}, kRecord},
    {{"query/extract_stats.h", "ExtractStats"}, kRecord},
    {{"store/object_record.h", "ObjectRecord"}, kRecord},
    {{"tools/cli/verbs/ingest_arguments.h", "IngestArguments"}, kRecord},
    {{"tools/cli/query_report.h", "QueryArguments"}, kRecord},
    {{"tools/client/client.h", "RemoteUpdate"}, kRecord},
    {{"tools/render/render.h", "RenderOptions"}, kRecord},
    {{"tools/request/query_options.h", "QueryOptions"}, kRecord},
    {{"tools/server/internal/server_metrics.h", "ServerMetrics"},
     "a record of counters, each of which is a line of /metrics"},
    {{"tools/web/wasm/engine.cc", "State"},
     "what the module keeps between calls, each for a function of its interface"},
    // One thing that takes so many.
    {{"store/base/json.h", "Json"},
     "a value that is made of all kinds of values, and asked for each"},
    {{"codecs/cluster/cluster_codec.cc", "ClusterDecoder"}, kPhases},
    {{"codecs/cluster/cluster_encoder.cc", "Replay"}, kPhases},
    {{"codecs/cluster/internal/lattice.h", "Lattice"},
     "one set of points, in loops that are the codec's innermost"},
    {{"codecs/mesh_file/readers/gltf_reader.cc", "GltfReader"}, kPhases},
    {{"codecs/mesh_file/readers/ply_reader.cc", "PlyBody"},
     "a reader of one grammar: a function for each of its rules"},
    {{"codecs/mesh_file/writers/mesh_writer.h", "MeshWriter"},
     "the base of the formats: a third of it is what they override, a third what they ask"},
    {{"codecs/stream/encode/delaunay_encoder.h", "DelaunayEncoder"},
     "notes, and then sends: members are scratch that lasts, so that nothing is allocated"},
    {{"builder/holes/tile_mesh.h", "TileMesh"},
     "one half-edge mesh: a third of it is what others ask of a vertex"},
    {{"codecs/stream/encode/batch_encoder.h", "BatchEncoder"},
     "a writer of one grammar, with scratch that lasts, so that nothing is allocated"},
    {{"codecs/stream/internal/replayed_mesh.h", "ReplayedMesh"},
     "one half-edge mesh in slots, whose changes are the codec's innermost loops"},
    {{"codecs/stream/internal/update_coder.h", "UpdateModels"}, "a model for each kind of symbol"},
    {{"codecs/stream/update_decoder.cc", "UpdateDecoder::Impl"},
     "a reader of one grammar, with scratch that lasts, so that nothing is allocated"},
    {{"query/ask/verify_object.cc", "Verifier"}, "counters, each of which is a line of the report"},
    {{"query/answer/cut_impl.h", "CutImpl"},
     "an answer: selecting, numbering and sending it, with scratch that all units share"},
    {{"query/cache/compact_cluster.h", "CompactCluster"},
     "the arrays of a cluster (codecs/cluster), packed"},
    {{"store/carriers/http_ranges.cc", "Loop"}, "a thread and what it shares under one mutex"},
    {{"store/lmdb/object_writer.h", "StoreObjectWriter"},
     "one transaction after the other: what waits, what is queued, what is counted"},
    {{"tools/client/remote_session.cc", "RemoteSession::Impl"},
     "a connection with the queries that it has no answer to, and counters"},
    {{"tools/generate/internal/surface_walker.h", "SurfaceWalker"}, kPhases},
    {{"tools/server/http/server_connection.cc", "Connection"},
     "a state machine: a function for each event"},
    {{"tools/server/http/server_websocket.h", "ServerWebSocket"},
     "a state machine: a function for each event"},
    {{"tools/server/internal/server_pool.h", "ServerPool"},
     "a queue and its threads under one mutex"},
    {{"tools/server/internal/server_service.h", "ServerService"},
     "a function for each kind of request"},
    {{"tools/web/wasm/slot_mesh.h", "SlotMesh"},
     "one mesh in slots: an array for each thing that is drawn, and where slots are free"},
};

struct Class {
  std::string name;
  size_t line = 0;       // from 1
  size_t functions = 0;  // declared in it, but for those that are defaulted or deleted
  size_t members = 0;    // of each of its objects
};

// Names, numbers, and signs one by one, but for "::" and "->"; where each begins. Without lines of
// the preprocessor and what is between quotes.
struct Token {
  std::string text;
  size_t line;
};
std::vector<Token> TokensOf(const std::string& code) {
  std::vector<Token> tokens;
  size_t number = 0;
  bool goes_on = false;  // a line of the preprocessor
  for (const std::string& line : LinesOf(code)) {
    ++number;
    const bool skips = goes_on || Trimmed(line).starts_with("#");
    goes_on = skips && line.ends_with("\\");
    if (skips) continue;
    for (size_t i = 0; i < line.size();) {
      const auto is_word = [&](size_t at) {
        return at < line.size() &&
               (std::isalnum(static_cast<unsigned char>(line[at])) != 0 || line[at] == '_' ||
                (line[at] == '\'' && at > i &&
                 std::isdigit(static_cast<unsigned char>(line[i])) != 0));
      };
      size_t end = i;
      if (is_word(i)) {
        while (is_word(end)) ++end;
      } else if (line[i] == '"' || line[i] == '\'') {
        for (end = i + 1; end < line.size() && line[end] != line[i]; ++end)
          end += line[end] == '\\';
        ++end;
      } else {
        const std::string two = line.substr(i, 2);
        end += two == "::" || two == "->" ? 2 : 1;
      }
      end = std::min(end, line.size());
      if (line[i] != ' ') tokens.push_back({line.substr(i, end - i), number});
      i = end;
    }
  }
  return tokens;
}

// Reads declarations as they are written in this project, without knowing what their names mean.
class ClassReader {
 public:
  explicit ClassReader(const std::string& code) : tokens_(TokensOf(code)) {}

  std::vector<Class> Read() {
    while (at_ < tokens_.size()) ReadScope(nullptr);
    return std::move(classes_);
  }

 private:
  // To the end of what a brace has opened.
  void ReadScope(Class* of) {
    while (at_ < tokens_.size() && Peek() != "}") ReadStatement(of);
    ++at_;
  }
  std::string Peek() const { return at_ < tokens_.size() ? tokens_[at_].text : ""; }
  std::string Last() const { return at_ == 0 ? "" : tokens_[at_ - 1].text; }
  static bool IsName(const std::string& text) {
    return !text.empty() &&
           (std::isalnum(static_cast<unsigned char>(text[0])) != 0 || text[0] == '_');
  }
  // Behind the bracket that closes the one that is next.
  void Skip(const std::string& open, const std::string& close) {
    size_t depth = 0;
    do {
      if (Peek() == open) ++depth;
      if (Peek() == close) --depth;
      if (open == "<" && Peek() == "(") {
        Skip("(", ")");
      } else {
        ++at_;
      }
    } while (depth > 0 && at_ < tokens_.size());
  }

  // One declaration: of a function, of members, of a class, or of something else.
  struct Statement {
    std::string kind;  // "class" is for structs too; "using" and others declare nothing here
    std::string name;  // of a class
    bool calls = false, is_value = false;
    bool lists = false;  // base classes, or what a constructor sets
    size_t declared = 1;
    bool none = false;  // defaulted or deleted
  };
  void ReadStatement(Class* of) {
    static const std::set<std::string> kNothing{"using", "typedef", "friend", "static_assert"};
    static const std::set<std::string> kNoCall{"alignas", "decltype", "noexcept", "requires"};
    Statement s;
    const size_t begin = at_;
    if (kNothing.contains(Peek())) s.kind = "nothing";
    while (at_ < tokens_.size()) {
      const std::string t = Peek();
      if (t == "}") return;
      if (t == ";") break;
      const bool in_head = s.kind == "class";
      if (t == "[") {
        Skip("[", "]");
      } else if (t == "operator") {
        s.calls = true;
        at_ += 2;
        while (at_ < tokens_.size() && Peek() != "(") ++at_;
      } else if (t == "<" && IsName(Last()) && !s.is_value) {
        Skip("<", ">");
      } else if (t == "(") {
        s.calls |= !s.is_value && !kNoCall.contains(Last());
        Skip("(", ")");
      } else if (t == "{") {
        if (s.kind == "namespace") {
          ++at_;
          return ReadScope(nullptr);
        }
        if (in_head) {
          ReadClass(s.name);
          s.kind = "declared";
          s.declared = Peek() == ";" ? 0 : 1;
        } else if (s.calls && !s.is_value && !(s.lists && (IsName(Last()) || Last() == ">"))) {
          Skip("{", "}");
          if (of != nullptr && s.kind != "nothing") ++of->functions;
          return;
        } else {
          Skip("{", "}");
        }
      } else {
        if (t == "=") s.is_value = true;
        if (t == ",") ++s.declared;
        if (t == ":") s.lists = true;
        if (t == ":" && at_ == begin + 1 && of != nullptr) {
          ++at_;
          return;  // public: and so on
        }
        if (s.kind.empty() && (t == "namespace" || t == "extern")) s.kind = "namespace";
        if (s.kind.empty() && (t == "enum" || t == "static")) s.kind = t;
        if (s.kind.empty() && !s.calls && (t == "class" || t == "struct" || t == "union")) {
          s.kind = "class";
        }
        if (in_head && !s.lists && Last() == "::") s.name += "::" + t;
        if (in_head && !s.lists && s.name.empty() && IsName(t) && t != "alignas") s.name = t;
        s.none |= s.is_value && (t == "default" || t == "delete");
        ++at_;
      }
    }
    ++at_;
    if (of == nullptr || s.kind == "nothing" || s.kind == "enum" || s.kind == "class" || s.none)
      return;
    if (s.calls) {
      ++of->functions;
    } else if (s.kind != "static") {
      of->members += s.declared;
    }
  }
  void ReadClass(const std::string& name) {
    Class c{name, tokens_[at_].line};
    ++at_;
    ReadScope(&c);
    classes_.push_back(c);
  }

  const std::vector<Token> tokens_;
  size_t at_ = 0;
  std::vector<Class> classes_;
};

std::vector<Class> ClassesOf(const std::string& text) {
  return ClassReader(Separate(text).code).Read();
}

// What is against the law in the product's folders. `larger`: the exceptions, none of which is
// superfluous.
template <typename Larger>
Violations FindLarge(const Texts& texts, const Larger& larger) {
  Violations violations;
  std::set<std::pair<std::string, std::string>> excused;
  for (const auto& [path, text] : texts) {
    if (!IsCode(path) || !kFolders.contains(path.substr(0, path.find('/')))) continue;
    for (const Class& c : ClassesOf(text)) {
      if (c.functions <= kMaxFunctions && c.members <= kMaxMembers) continue;
      if (larger.contains({path, c.name})) {
        excused.insert({path, c.name});
        continue;
      }
      violations.push_back(path + ":" + std::to_string(c.line) + ": " + c.name + " has " +
                           std::to_string(c.functions) + " functions and " +
                           std::to_string(c.members) + " members, at most " +
                           std::to_string(kMaxFunctions) + " and " + std::to_string(kMaxMembers));
    }
  }
  for (const auto& [place, reason] : larger) {
    if (!excused.contains(place)) {
      violations.push_back(place.first + ": " + place.second + " needs no exception");
    }
  }
  return violations;
}

TEST_CASE("a class is one idea", "[layers]") {
  for (const std::string& violation : FindLarge(ProjectTexts(), kLarger)) FAIL_CHECK(violation);
}

TEST_CASE("the law for classes finds planted violations", "[layers]") {
  const auto repeated = [](const std::string& what, size_t times) {
    std::string all;
    for (size_t i = 0; i < times; ++i) all += "  " + what + std::to_string(i) + ";\n";
    return all;
  };
  const auto with = [&](size_t functions, size_t members) {
    std::string text = "class A {\n public:\n  A() = default;\n  A(const A&) = delete;\n";
    for (size_t i = 0; i < functions; ++i) text += "  void F" + std::to_string(i) + "();\n";
    return Texts{{"query/cut/a.h", text + " private:\n" + repeated("int a", members) + "};\n"}};
  };
  const std::map<std::pair<std::string, std::string>, std::string> none;
  CHECK(FindLarge(with(25, 15), none).empty());
  CHECK(FindLarge(with(26, 0), none).size() == 1);
  CHECK(FindLarge(with(0, 16), none).size() == 1);
  const std::map<std::pair<std::string, std::string>, std::string> a{{{"query/cut/a.h", "A"}, ""}};
  CHECK(FindLarge(with(26, 16), a).empty());
  CHECK(FindLarge(with(25, 15), a).size() == 1);  // it is there for nothing
  CHECK(FindLarge({}, a).size() == 1);
}

TEST_CASE("functions and members of classes are counted", "[layers]") {
  const std::vector<Class> classes = ClassesOf(R"(
#define MTDB_X(a) class B { int a; }
namespace mtdb {
class Elsewhere;
enum class Kind : uint8_t { kOne, kTwo };
template <typename T, size_t kSize = 3>
class [[nodiscard]] A final : public Base<T>, private Other {
 public:
  using Take = std::function<void(int, int)>;
  explicit A(int x) : x_(x), list_{x, x} { Run(); }  // and no member "int y_;"
  A(const A&) = delete;
  ~A() override = default;
  template <typename F>
  Status Each(F&& f) const {
    for (int i = 0; i < 3; ++i) f(i);
    return Status::Ok();
  }
  friend bool operator==(const A&, const A&) = default;
  bool operator<(const A& other) const { return x_ < other.x_; }
  static int Zero() { return 0; }
  [[nodiscard]] const std::map<int, Take>& takes() const;
  static constexpr int kMost = 3;

 private:
  struct Inner {
    int a = 0, b = 0;
    int Sum() const { return a + b; }
  };
  friend class Elsewhere;
  alignas(32) std::array<int, 3> list_{};
  int x_ = 0, y_ = Zero();
  Take take_ = [](int, int) {};
  std::function<void(int, int)> other_;
  struct {
    int c;
  } at_hand_;
};
void Free();
int Other::value() const { return 3; }
class Other::Impl : public A<int> {
  int a;
};
}  // namespace mtdb
)");
  REQUIRE(classes.size() == 4);
  CHECK(classes[0].name == "Inner");
  CHECK(classes[0].functions == 1);
  CHECK(classes[0].members == 2);
  CHECK(classes[1].members == 1);
  CHECK(classes[2].name == "A");
  CHECK(classes[2].functions == 5);
  CHECK(classes[2].members == 6);
  CHECK(classes[2].line == 7);
  CHECK(classes[3].name == "Other::Impl");
  CHECK(classes[3].members == 1);
}

}  // namespace
}  // namespace mtdb::test
