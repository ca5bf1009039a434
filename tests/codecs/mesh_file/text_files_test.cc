// SPDX-License-Identifier: Apache-2.0
// What texts of every format have in common: byte order marks, line ends, continued lines, numbers
// that are left over.
#include <vector>
#include <zlib.h>

#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using testing::AppendValue;
using testing::ReadGood;
using testing::ReadOutcome;
using testing::ReadPath;
using testing::ReadText;
using testing::RequireBadInput;
using testing::ScratchFolder;

struct Sample {
  const char* name;
  std::string text;
};

// The same mesh in every text.
const std::vector<Sample>& Samples() {
  static const std::vector<Sample> kSamples = {
      {"m.obj",
       "v 0 0 0\nv 1 0 0\nv 1 1 0.25\n\nv 0 1 0\nv 0.5 0.5 1\nf 1 2 5\nf 2 3 5\n# end\nf 3 4 5\n"},
      {"m.off",
       "OFF\n5 3 0\n0 0 0\n1 0 0\n\n1 1 0.25\n0 1 0\n0.5 0.5 1\n3 0 1 4\n# end\n3 1 2 4\n3 2 3 "
       "4\n"},
      {"m.ply",
       "ply\nformat ascii 1.0\ncomment of a kind\nelement vertex 5\nproperty float x\nproperty "
       "float "
       "y\nproperty float z\nelement face 3\nproperty list uchar int vertex_indices\nend_header\n0 "
       "0 "
       "0\n1 0 0\n1 1 0.25\n0 1 0\n0.5 0.5 1\n\n3 0 1 4\n3 1 2 4\n3 2 3 4\n"},
      {"m.stl",
       "solid a b\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0.5 0.5 "
       "1\nendloop\nendfacet\n\nfacet normal 0 0 1\nouter loop\nvertex 1 0 0\nvertex 1 1 "
       "0.25\nvertex 0.5 0.5 1\nendloop\nendfacet\nfacet normal 0 0 1\nouter loop\nvertex 1 1 "
       "0.25\nvertex 0 1 0\nvertex 0.5 0.5 1\nendloop\nendfacet\nendsolid a b\n"},
  };
  return kSamples;
}

std::string WithLineEnds(const std::string& text, const std::string& end) {
  std::string out;
  for (const char c : text) out += c == '\n' ? end : std::string(1, c);
  return out;
}

void CheckSame(const ReadOutcome& outcome, const ReadOutcome& plain) {
  INFO(outcome.status.message());
  REQUIRE(outcome.status.ok());
  REQUIRE(outcome.mesh.positions == plain.mesh.positions);
  REQUIRE(outcome.mesh.triangles == plain.mesh.triangles);
  REQUIRE(outcome.report.format == plain.report.format);
  REQUIRE(outcome.report.ignored == plain.report.ignored);
  REQUIRE(outcome.report.notes == plain.report.notes);
}

TEST_CASE("texts may begin with a byte order mark and end lines in LF, CR LF or CR") {
  for (const Sample& sample : Samples()) {
    const ReadOutcome plain = ReadGood(sample.name, sample.text);
    REQUIRE(plain.mesh.positions.size() == 5);
    REQUIRE(plain.mesh.triangles.size() == 3);
    for (const char* end : {"\n", "\r\n", "\r"}) {
      for (const char* mark : {"", "\xef\xbb\xbf"}) {
        for (const bool last_end : {true, false}) {
          std::string text = mark + WithLineEnds(sample.text, end);
          if (!last_end) text.resize(text.size() - std::strlen(end));
          CAPTURE(sample.name, std::string(end).size(), mark, last_end);
          CheckSame(ReadText(sample.name, text), plain);
          // Compressed, and from a file that is open.
          const ScratchFolder folder;
          const std::string path = folder.Path(std::string(sample.name) + ".gz");
          const gzFile file = ::gzopen(path.c_str(), "wb");
          ::gzwrite(file, text.data(), static_cast<unsigned>(text.size()));
          ::gzclose(file);
          CheckSame(ReadPath(path), plain);
        }
      }
    }
  }
}

TEST_CASE("lines that end in CR are counted as any") {
  for (const char* end : {"\n", "\r\n", "\r"}) {
    CAPTURE(std::string(end).size());
    const auto bad = [&](const char* name, const std::string& text, const char* part) {
      RequireBadInput(name, WithLineEnds(text, end), {part});
    };
    bad("b.obj", "v 0 0 0\n\nv 0 x 0\n", "line 3: expected a number, found 'x'");
    bad("b.off", "OFF\n1 0 0\n\n0 x 0\n", "line 4: expected a number, found 'x'");
    bad("b.ply", Samples()[2].text + "7\n", "line 20");
    bad("b.stl", "solid\n\nfacet x\n", "line 3: expected 'facet normal X Y Z'");
  }
}

// Lines around the ends of what is read at a time.
TEST_CASE("line ends are found wherever blocks end") {
  for (const char* end : {"\n", "\r\n", "\r"}) {
    for (size_t padding = 0; padding < 4; ++padding) {
      std::string text(padding, ' ');
      for (int i = 0; i < 60'000; ++i) text += "v " + std::to_string(i) + " 0 0\n";
      text += "f 1 2 60000\n";
      const ReadOutcome outcome = ReadGood("m.obj", WithLineEnds(text, end));
      REQUIRE(outcome.mesh.positions.size() == 60'000);
      REQUIRE(outcome.mesh.positions[59'999].x == 59'999);
      REQUIRE(outcome.report.ignored.empty());
    }
  }
}

TEST_CASE("the values of binary PLY begin behind the line end of end_header, whichever it is") {
  for (const char* end : {"\n", "\r\n", "\r"}) {
    std::string file = WithLineEnds(
        "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uchar a\nproperty float "
        "x\nproperty float y\nproperty float z\nend_header\n",
        end);
    // A line feed, as a value.
    file += '\n';
    for (const float v : {1.f, 2.f, 3.f}) AppendValue(&file, v);
    const ReadOutcome outcome = ReadGood("m.ply", file);
    REQUIRE(outcome.mesh.positions == std::vector<Vec3d>{{1, 2, 3}});
    REQUIRE(outcome.mesh.rows == Bytes{std::byte{'\n'}});
    REQUIRE(outcome.report.ignored.empty());
  }
}

TEST_CASE("texts in UTF-16 are refused with what to do") {
  for (const Sample& sample : Samples()) {
    for (const bool big : {false, true}) {
      for (const bool marked : {false, true}) {
        CAPTURE(sample.name, big, marked);
        std::string text;
        if (marked) text = big ? "\xfe\xff" : "\xff\xfe";
        for (const char c : sample.text) AppendValue(&text, static_cast<uint16_t>(c), big);
        RequireBadInput(sample.name, text, {"UTF-16", "convert it first"});
      }
    }
  }
}

TEST_CASE("OBJ: a backslash continues vertices and faces; names and comments end with their line") {
  const std::string vertices = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
  const std::vector<TriangleVertices> expected{{0, 1, 2}, {0, 2, 3}};
  for (const char* line : {"# part of C:\\scans\\", "usemtl C:\\red\\", "mtllib a\\", "o x \\ ",
                           "g \\", "s off\\", "vn 0 0 \\\n1 \\\n", "vt 0 \\\n 0.5", "unknown \\",
                           "  # \\", "\\", "f 1 2 3 # C:\\\nf 1 3 4 # \\\n#"}) {
    CAPTURE(line);
    std::string text = vertices + line + "\nf 1 2 3\nf 1 3 \\  \n4\n";
    const ReadOutcome outcome = ReadGood("c.obj", text);
    REQUIRE(outcome.mesh.positions.size() == 4);
    const auto& all = outcome.mesh.triangles;
    REQUIRE(std::vector<TriangleVertices>(all.end() - 2, all.end()) == expected);
    REQUIRE(all.size() == (line[0] == 'f' ? 4 : 2));
  }
}

TEST_CASE("OFF may leave its keyword out, or stick it to the first count") {
  const std::string body =
      "5 3 0\n0 0 0\n1 0 0\n1 1 0.25\n0 1 0\n0.5 0.5 1\n3 0 1 4\n3 1 2 4\n3 2 3 4\n";
  const ReadOutcome plain = ReadGood("m.off", "OFF\n" + body);
  for (const char* start : {"", "OFF", "OFF ", "off\n", "# a comment\n", "# one\nOFF"}) {
    CAPTURE(start);
    CheckSame(ReadText("m.off", start + body), plain);
  }
  REQUIRE(ReadGood("m.txt", "OFF" + body).mesh.triangles.size() == 3);
  RequireBadInput("m.off", "OFFx 3 0\n", {"expected 'OFF', found 'OFFx'"});
  RequireBadInput("m.off", "5 x 0\n", {"expected the counts 'V F E'"});
}

TEST_CASE("PLY text whose lines have other numbers of values than the header says is refused") {
  const std::string header =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float "
      "z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
  const auto bad = [&](const std::string& body, std::initializer_list<const char*> parts) {
    RequireBadInput("m.ply", header + body, parts);
  };
  bad("0 0 0 9\n1 0 0 9\n0 1 0 9\n3 0 1 2\n",
      {"line 12: numbers are left over", "line 10 has other numbers of values"});
  bad("0 0 0 0\n1 0 0 0\n0 1 0 0\n3 0 1 2\n",
      {"numbers are left over", "line 10 has other numbers"});
  bad("0 0 0 1 2 3\n1 0 0 1 2 3\n0 1 0 0 0 0\n3 0 1 2\n", {"m.ply"});
  bad("0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 2 1 0\n", {"line 14", "numbers are left over", "'3'"});
  bad("0 0 0\n1 0 0\n0 1 0\n3 0 1 2 7\n", {"line 13", "numbers are left over", "'7'"});
  // Lines may be broken anywhere, and be one.
  for (const char* body :
       {"0 0 0 1 0 0 0 1 0 3 0 1 2", "0 0\n0\n1 0 0\n\n0\n1 0\n3 0\n1 2\n",
        "0 0 0 1 0\n0 0 1\n0 3 0 1\n2", "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\nThe end.\n"}) {
    CAPTURE(body);
    REQUIRE(ReadGood("m.ply", header + body).mesh.triangles ==
            std::vector<TriangleVertices>{{0, 1, 2}});
  }
}

TEST_CASE("numbers behind a vertex of OBJ and OFF are told, of text STL refused") {
  const ReadOutcome obj = ReadGood("m.obj", "v 0 0 0 1 1 1 1 5\nv 1 0 0 1 1 1 1 5 6 7\n");
  REQUIRE(obj.report.ignored == std::vector<std::string>{"numbers behind the colour of a vertex"});
  REQUIRE(obj.mesh.positions[1] == Vec3d{1, 0, 0});
  const ReadOutcome off = ReadGood("m.off", "OFF\n1 0 0\n0 0 1 255 0 0\n");
  REQUIRE(off.report.ignored == std::vector<std::string>{"values after a vertex"});
  RequireBadInput("m.stl", "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0 7\n",
                  {"line 4: expected 'vertex X Y Z' and no more"});
}

TEST_CASE("text STL is known behind white space and in capital letters") {
  const Sample& stl = Samples()[3];
  const ReadOutcome plain = ReadGood("m.stl", stl.text);
  for (const char* start : {"\n  ", "\r\n", "\t", "\xef\xbb\xbf \n"}) {
    CAPTURE(start);
    CheckSame(ReadText("m.stl", start + stl.text), plain);
    CheckSame(ReadText("unnamed", start + stl.text), plain);
  }
  std::string capitals = stl.text;
  for (char& c : capitals) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  CheckSame(ReadText("m.stl", capitals), plain);
}

TEST_CASE("normals of text STL may be anything, as they are not used") {
  const std::string stl = Samples()[3].text;
  const ReadOutcome plain = ReadGood("m.stl", stl);
  for (const char* normal : {"-1.#IND -1.#IND -1.#IND", "nan nan nan", "1.#QNAN 0 0", "none",
                             "-nan(ind) -nan(ind) -nan(ind)", "0,5 0,5 0"}) {
    CAPTURE(normal);
    std::string text = stl;
    for (size_t at = 0; (at = text.find("0 0 1\nouter", at)) != std::string::npos; ++at) {
      text.replace(at, 5, normal);
    }
    CheckSame(ReadText("m.stl", text), plain);
  }
  std::string bad = stl;
  bad.replace(bad.find("vertex 1 0 0"), 12, "vertex 1 -1.#IND 0");
  RequireBadInput("m.stl", bad, {"line 5: y is nan"});
}

TEST_CASE("binary STL without a count is as long as the file, which is told") {
  std::string facets;
  for (int i = 0; i < 2; ++i) {
    for (int k = 0; k < 12; ++k) AppendValue(&facets, k < 3 ? 0.f : static_cast<float>(k * k + i));
    facets += std::string(2, '\0');
  }
  for (const uint32_t count : {0u, 0xffffffffu}) {
    CAPTURE(count);
    std::string file(80, ' ');
    AppendValue(&file, count);
    const ReadOutcome outcome = ReadGood("m.stl", file + facets);
    REQUIRE(outcome.mesh.triangles.size() == 2);
    REQUIRE(outcome.report.notes.size() == 1);
    REQUIRE(outcome.report.notes[0].find("2 follow and were read") != std::string::npos);
    RequireBadInput("m.stl", file + facets + "x", {count == 0 ? "101 bytes follow" : "promises"});
  }
}

TEST_CASE("numbers as Microsoft's library printed them are no finite numbers") {
  for (const char* text : {"1.#INF", "-1.#INF00", "-1.#IND", "1.#QNAN", "1.#SNAN"}) {
    CAPTURE(text);
    const ReadOutcome outcome =
        ReadGood("m.obj", std::string("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 ") + text + " 0\nf 1 2 3\n");
    REQUIRE(outcome.report.left_out_vertices == 1);
    REQUIRE(outcome.mesh.positions.size() == 3);
  }
  RequireBadInput("m.obj", "v 0 0 1.#X\n", {"expected a number, found '1.#X'"});
}

}  // namespace
}  // namespace mtdb
