// SPDX-License-Identifier: Apache-2.0
// URLs of packed files: what is asked of whom, and how messages name it.
#pragma once

#include <string>

#include "store/base/status.h"

namespace mtdb::internal {

struct HttpPlace {
  std::string url;    // http or https
  std::string shown;  // without passwords and signatures
  // Empty unless requests are signed.
  std::string signature_scope;  // for CURLOPT_AWS_SIGV4
  std::string credentials;      // key and secret, with a colon between them
  std::string session_token;
  std::string certificates;  // a file of those to trust; empty: the system's
};

// Certificates are of the file that CURL_CA_BUNDLE or SSL_CERT_FILE names, as curl has it.
// Of "http://...", "https://..." as they are. Of "s3://bucket/key" by the variables of the
// environment that AWS's own tools take: AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY (without them
// requests are not signed), AWS_SESSION_TOKEN, AWS_REGION or AWS_DEFAULT_REGION (us-east-1), and
// AWS_ENDPOINT_URL_S3 or AWS_ENDPOINT_URL for another service than Amazon's.
Result<HttpPlace> PlaceOfUrl(const std::string& url);

}  // namespace mtdb::internal
