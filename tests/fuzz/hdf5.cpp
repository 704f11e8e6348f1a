// HDF5 files whose container is whole and whose datasets are made of the input: types, layouts, sizes, values, ECF
// blocks. The bytes of the container itself meet the HDF5 library, whose defects are known
// (docs/reference/event_file.md).
#include <hdf5.h>

#include <array>

#include "fuzz.h"
#include "hdf5_file.h"
#include "pecs/events/format.h"

namespace {

using namespace pecs;
using events::hdf5::Handle;
using fuzz::Bytes;

hid_t number_type(unsigned choice) {
  const std::array types = {H5T_STD_I8LE,  H5T_STD_U8LE,  H5T_STD_I16LE, H5T_STD_U16LE, H5T_STD_I32BE,
                            H5T_STD_U32LE, H5T_STD_I64LE, H5T_STD_U64LE, H5T_IEEE_F64LE};
  return types[choice % types.size()];
}

// `count` items declared, of which as many are written as `rest` has: what is missing was never stored.
void put_dataset(hid_t file, const char* name, hid_t type, Bytes& in) {
  const auto layout = in.take<std::uint8_t>();
  const hsize_t count = in.take<std::uint16_t>(), chunk = 1 + layout / 4;
  const Handle links(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
  H5Pset_create_intermediate_group(links.get(), 1);
  const Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  if (layout % 4) H5Pset_chunk(properties.get(), 1, &chunk);
  if (layout % 4 == 2) H5Pset_deflate(properties.get(), 1);
  const Handle space(H5Screate_simple(1, &count, nullptr), H5Sclose);
  const Handle dataset(H5Dcreate2(file, name, type, space.get(), links.get(), properties.get(), H5P_DEFAULT), H5Dclose);
  const hsize_t start = 0, stored = std::min<hsize_t>(count, in.rest().size() / H5Tget_size(type));
  if (!dataset || stored == 0) return;
  const Handle memory(H5Screate_simple(1, &stored, nullptr), H5Sclose);
  H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, &start, nullptr, &stored, nullptr);
  H5Dwrite(dataset.get(), type, memory.get(), space.get(), H5P_DEFAULT, in.rest().data());
}

void put_dsec(hid_t file, Bytes& in) {
  for (const char* name : {"/events/t", "/events/x", "/events/y", "/events/p"})
    put_dataset(file, name, number_type(in.take<std::uint8_t>()), in);
  if (const auto kind = in.take<std::uint8_t>()) {
    const Handle space(H5Screate(H5S_SCALAR), H5Sclose);
    const Handle offset(H5Dcreate2(file, "/t_offset", number_type(kind), space.get(), 0, 0, 0), H5Dclose);
    const auto value = in.take<std::int64_t>();
    H5Dwrite(offset.get(), number_type(kind), H5S_ALL, H5S_ALL, H5P_DEFAULT, &value);
  }
  const Handle group(H5Gopen2(file, "/events", H5P_DEFAULT), H5Gclose);
  events::hdf5::write_attribute(group.get(), "width", in.take<std::int16_t>());
  events::hdf5::write_attribute(group.get(), "height", in.take<std::int16_t>());
}

void put_metavision(hid_t file, Bytes& in) {
  const auto kind = in.take<std::uint8_t>();
  const std::string geometry(in.rest().substr(0, kind % 12));
  events::hdf5::write_attribute(file, "geometry", std::string(geometry.c_str()));
  const Handle type(H5Tcreate(H5T_COMPOUND, 32), H5Tclose);
  const char* members[] = {"t", "x", "y", "p"};
  for (std::size_t i = 0; i < 4; ++i)
    H5Tinsert(type.get(), members[i], 8 * i, number_type(kind & 1 ? in.take<std::uint8_t>() : 6));
  if (kind & 2) {
    put_dataset(file, "/CD/events", type.get(), in);
    return;
  }
  // One chunk under the ECF filter, its block as it comes.
  const Handle group(H5Gcreate2(file, "/CD", 0, 0, 0), H5Gclose);
  const hsize_t count = in.take<std::uint16_t>() % 4096, chunk = 1 + in.take<std::uint16_t>(), start = 0;
  const Handle space(H5Screate_simple(1, &count, nullptr), H5Sclose);
  const Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  H5Pset_chunk(properties.get(), 1, &chunk);
  H5Pset_filter(properties.get(), 0x8ECF, H5Z_FLAG_OPTIONAL, 0, nullptr);
  const Handle dataset(H5Dcreate2(file, "/CD/events", type.get(), space.get(), 0, properties.get(), 0), H5Dclose);
  if (count > 0 && !in.rest().empty())
    H5Dwrite_chunk(dataset.get(), H5P_DEFAULT, 0, &start, in.rest().size(), in.rest().data());
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::MemoryFile file;
  file.hold({});
  {
    const events::hdf5::Session session;
    Bytes in(fuzz::text(data, size));
    const Handle hdf5(H5Fcreate(file.path().c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose);
    if (!hdf5) fuzz::defect("HDF5 cannot write to memory");
    (fuzz::kKind == "dsec" ? put_dsec : put_metavision)(hdf5.get(), in);
  }
  fuzz::try_to([&] {
    const auto reader = events::open_reader(file.path(), fuzz::kKind);
    std::vector<events::Event> block(1000);
    for (std::size_t all = 0; const std::size_t n = reader->read(block);)
      if ((all += n) > UINT16_MAX) fuzz::defect("more events than were declared");
  });
  return 0;
}
