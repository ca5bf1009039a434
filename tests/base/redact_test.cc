// SPDX-License-Identifier: Apache-2.0
#include "store/base/redact.h"

#include <array>
#include <catch2/catch.hpp>
#include <string>
#include <vector>

namespace mtdb::test {
namespace {

TEST_CASE("texts without URLs stay as they are") {
  for (const std::string text :
       {"", "a.ply: no such file", "b@c: no object", "a:b@c", "x?y=1: no such file",
        "http://localhost:8080/objects/scan: the server answered 404", "[::1]:80", "C:/a/b@c",
        "expected a URL such as http://localhost:8080/objects/scan, found 'x'",
        "http://[::1]:8080/objects/a", "s3://bucket/a/b.mtdbp: no such file",
        "http://www.opengis.net/gml/srs/epsg.xml#4326"}) {
    CHECK(WithoutSecrets(text) == text);
  }
}

TEST_CASE("users, passwords and queries of URLs do not stay in a text") {
  const std::vector<std::array<std::string, 2>> cases{
      {"https://user:secret@host/x", "https://host/x"},
      {"https://user@host:80/x: gone", "https://host:80/x: gone"},
      {"https://u:se@cret@host/x", "https://host/x"},
      {"https://u:sec/ret@host/x", "https://host/x"},
      {"https://u:sec?ret@host/x", "https://host/x"},
      {"https://u:sec#ret@host/x", "https://host/x"},
      {"https:/u:secret@host/x", "https:/host/x"},
      {"found 'https://u:secret@host/x'", "found 'https://host/x'"},
      {"https://h/x?X-Amz-Signature=abc: the server answered 403",
       "https://h/x: the server answered 403"},
      {"'https://h/x?sig=a%2Bb&se=1'", "'https://h/x'"},
      {"https://h/x?a='&sig=abc", "https://h/x"},
      {"https://h/x?GoogleAccessId=a&Signature=b, then", "https://h/x, then"},
      {"a https://u:p@h/x?t=1 and https://v:q@i/y?t=2.", "a https://h/x and https://i/y."},
      {"htps:h/x?X-Amz-Credential=abc&n=1", "htps:h/x?X-Amz-Credential=...&n=1"},
      {"h/x?token=abc: no such file", "h/x?token=... no such file"},
      {"x#access_token=abc&n=1", "x#access_token=...&n=1"},
      {"key AKIAABCDEFGHIJKLMNOP is wrong", "key AKIA... is wrong"},
  };
  for (const auto& [text, shown] : cases) CHECK(WithoutSecrets(text) == shown);
}

TEST_CASE("no secret stays wherever in a text a URL is") {
  const std::string secret = "S3cr3tS3cr3t";
  for (const std::string scheme : {"http://", "https://", "s3://", "ftp:/", "HTTPS://"}) {
    for (const std::string& url :
         {"user:" + secret + "@host/a", secret + "@host", "host/a?X-Amz-Signature=" + secret,
          "host/a?x=1&X-Amz-Security-Token=" + secret + "&y=2", "host/a?sig=" + secret,
          "u:" + secret + "/@host:80/b?sig=" + secret, "host?" + secret, "host/?token=" + secret,
          "host/x#token=" + secret, "u:" + secret + "@h@host/a?b?sig=" + secret}) {
      for (const std::string around : {"", "'", "\"", "(", ": "}) {
        const std::string text = "one " + around + scheme + url + around + ": two";
        INFO(text);
        const std::string shown = WithoutSecrets(text);
        CHECK(shown.find(secret) == std::string::npos);
        CHECK(shown.find("one ") == 0);
        CHECK(shown.find("two") != std::string::npos);
        CHECK(WithoutSecrets(shown) == shown);
      }
    }
  }
}

}  // namespace
}  // namespace mtdb::test
