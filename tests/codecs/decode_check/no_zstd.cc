// SPDX-License-Identifier: Apache-2.0
// In zstd's place where there is no zstd for a machine: decode_dump's payloads have no frames.
#include <cstdlib>

#include "zstd.h"
#include "zstd_errors.h"

extern "C" {
size_t ZSTD_freeCCtx(ZSTD_CCtx*) { return 0; }
size_t ZSTD_freeDCtx(ZSTD_DCtx*) { return 0; }
ZSTD_CCtx* ZSTD_createCCtx(void) { std::abort(); }
ZSTD_DCtx* ZSTD_createDCtx(void) { std::abort(); }
size_t ZSTD_compressBound(size_t) { std::abort(); }
size_t ZSTD_CCtx_reset(ZSTD_CCtx*, ZSTD_ResetDirective) { std::abort(); }
size_t ZSTD_CCtx_setParameter(ZSTD_CCtx*, ZSTD_cParameter, int) { std::abort(); }
size_t ZSTD_compress2(ZSTD_CCtx*, void*, size_t, const void*, size_t) { std::abort(); }
size_t ZSTD_decompressDCtx(ZSTD_DCtx*, void*, size_t, const void*, size_t) { std::abort(); }
unsigned ZSTD_isError(size_t) { return 1; }
ZSTD_ErrorCode ZSTD_getErrorCode(size_t) { return ZSTD_error_GENERIC; }
}
