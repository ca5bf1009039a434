#include "tools/gdal/module/module.h"

extern "C" __attribute__((visibility("default"))) const mtdb::GdalEntries* mtdb_gdal_entries() {
  static const mtdb::GdalEntries entries{&mtdb::OpenByGdal, &mtdb::CreateByGdal};
  return &entries;
}
