// SPDX-License-Identifier: Apache-2.0
#include "tools/gdal/module/module.h"

extern "C" __attribute__((visibility("default"))) const mtdb::GdalEntries* mtdb_gdal_entries() {
  static const mtdb::GdalEntries kEntries{&mtdb::OpenByGdal, &mtdb::CreateByGdal,
                                          &mtdb::ReadImageByGdal};
  return &kEntries;
}
