/* The operations of HDF5 that this program needs; hdf5_tools.f90 declares them to Fortran and says what they are for.

   The last argument of each is the status of a sequence of calls. After the first failure HDF5 is not called any more, which TRY
   sees to, so that a sequence is checked once, at its end; objects that remain open are closed with their file. Texts are
   variable-length UTF-8, and the dimension that varies slowest is the first. All of this exists in HDF5 1.10, 1.12, 1.14 and 2.0:
   functions whose structures have changed, like H5Lget_info, are not called. Sources: HDF5 1.10 reference manual; HDF5 Dimension
   Scale Specification. */
#include <hdf5.h>
#include <H5DSpublic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* What the last call returned, negative after a failure. */
typedef struct { int status; } sequence;

/* A dataset that grows: one number or text in each row, or rows of row_length numbers; 0: it has one dimension. */
typedef struct { hid_t id; hsize_t rows, row_length; } dataset;

/* How values are stored, as in hdf5_tools.f90. */
enum { as_text, as_double, as_int8, as_int32, as_int64 };

static int64_t take(int64_t returned, sequence *h5) {
  if (returned < 0) h5->status = -1;
  return returned;
}
#define TRY(call) (h5->status < 0 ? -1 : take(call, h5))

static void release(hid_t object, sequence *h5) { TRY(H5Idec_ref(object)); }

/* Files. */

void dst_ignore_size_limit_signal(void);

/* Create a file, in place of one that has the name, or open one for reading. No messages on errors, no signal at a limit of file
   sizes, no locks of HDF5's own, which would be in the way of those of result_file, and not its clean-up at exit, which loops
   forever if the disk is full. The format is the oldest with checksums of the metadata: a file of a newer one would have to be
   released with h5clear after a kill. */
hid_t dst_h5_open(const char *path, _Bool is_new, sequence *h5) {
  if (h5->status < 0) return -1;
  dst_ignore_size_limit_signal();
  setenv("HDF5_USE_FILE_LOCKING", "FALSE", 1);
  H5dont_atexit();
  TRY(H5Eset_auto2(H5E_DEFAULT, NULL, NULL));
  hid_t access = TRY(H5Pcreate(H5P_FILE_ACCESS));
  TRY(H5Pset_fclose_degree(access, H5F_CLOSE_STRONG));
  TRY(H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_V18));
  hid_t file = is_new ? TRY(H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, access)) : TRY(H5Fopen(path, H5F_ACC_RDONLY, access));
  release(access, h5);
  return file;
}

void dst_h5_close(hid_t file, sequence *h5) {
  if (file >= 0 && H5Fclose(file) < 0) h5->status = -1;
}

static herr_t keep_first(unsigned depth, const H5E_error2_t *entry, void *description) {
  if (depth == 0) *(const char **)description = entry->desc;
  return 0;
}

/* HDF5's own words on the last call that failed; NULL: it gave none. */
const char *dst_h5_failure(void) {
  const char *description = NULL;
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, keep_first, &description);
  return description;
}

hid_t dst_h5_create_group(hid_t parent, const char *name, sequence *h5) {
  return TRY(H5Gcreate2(parent, name, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
}

/* Types and spaces. */

static hid_t type_of(int kind, sequence *h5) {
  hid_t type = -1;
  if (h5->status < 0) return type;
  switch (kind) {
    case as_text:
      type = TRY(H5Tcopy(H5T_C_S1));
      TRY(H5Tset_size(type, H5T_VARIABLE));
      TRY(H5Tset_cset(type, H5T_CSET_UTF8));
      return type;
    case as_double: return TRY(H5Tcopy(H5T_IEEE_F64LE));
    case as_int8: return TRY(H5Tcopy(H5T_STD_I8LE));
    case as_int32: return TRY(H5Tcopy(H5T_STD_I32LE));
    default: return TRY(H5Tcopy(H5T_STD_I64LE));
  }
}

/* The properties with which values are moved. For a conversion HDF5 would clear a buffer of 1 MB each time. */
static hid_t transfer_of(hsize_t values, sequence *h5) {
  const size_t least = 64, most = 1048576, bytes = 8 * (size_t)values;
  hid_t transfer = TRY(H5Pcreate(H5P_DATASET_XFER));
  TRY(H5Pset_buffer(transfer, bytes < least ? least : bytes > most ? most : bytes, NULL, NULL));
  return transfer;
}

/* Single values: attributes, and datasets without dimensions. */

/* Write the value of an attribute, and create the attribute if it does not exist. */
static void write_attribute(hid_t object, const char *name, hid_t stored_as, hid_t memory_type, const void *value, sequence *h5) {
  hid_t attribute;
  if (TRY(H5Aexists(object, name)) > 0) {
    attribute = TRY(H5Aopen(object, name, H5P_DEFAULT));
  } else {
    hid_t space = TRY(H5Screate(H5S_SCALAR));
    attribute = TRY(H5Acreate2(object, name, stored_as, space, H5P_DEFAULT, H5P_DEFAULT));
    release(space, h5);
  }
  TRY(H5Awrite(attribute, memory_type, value));
  release(attribute, h5);
}

/* The attributes that every dataset has. */
static void describe(hid_t dataset, const char *words, sequence *h5) {
  hid_t type = type_of(as_text, h5);
  words += strlen(words) + 1;
  write_attribute(dataset, "units", type, type, &words, h5);
  words += strlen(words) + 1;
  write_attribute(dataset, "long_name", type, type, &words, h5);
  release(type, h5);
}

static void write_scalar(hid_t group, const char *words, hid_t stored_as, hid_t memory_type, const void *value, sequence *h5) {
  hid_t space = TRY(H5Screate(H5S_SCALAR)), transfer = transfer_of(1, h5);
  hid_t dataset = TRY(H5Dcreate2(group, words, stored_as, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  TRY(H5Dwrite(dataset, memory_type, H5S_ALL, H5S_ALL, transfer, value));
  describe(dataset, words, h5);
  release(dataset, h5);
  release(space, h5);
  release(transfer, h5);
}

/* Write the text, or the number, as an attribute or a dataset. `words`: its name; of a dataset also its unit and its meaning, each
   with a NUL at its end. */
void dst_h5_put(hid_t object, const char *words, _Bool is_attribute, int kind, const char *text, double number, sequence *h5) {
  hid_t type = type_of(kind, h5);
  if (h5->status >= 0) {
    hid_t memory_type = kind == as_text ? type : H5T_NATIVE_DOUBLE;
    const void *value = kind == as_text ? (const void *)&text : (const void *)&number;
    (is_attribute ? write_attribute : write_scalar)(object, words, type, memory_type, value, h5);
  }
  release(type, h5);
}

/* Read the text or the number that an attribute of a group or else a dataset has. Another kind of value, and several, for which
   there is no room, count as a failure; texts must be given by their address. HDF5 allocates them, a few for each file:
   they are freed at the end of the process. */
const char *dst_h5_get(hid_t object, const char *name, int kind, double *number, sequence *h5) {
  const char *text = NULL, *slash = strrchr(name, '/');
  char group[32] = ".";
  if (slash) snprintf(group, sizeof group, "%.*s", (int)(slash - name), name);
  _Bool is_attribute = TRY(H5Aexists_by_name(object, group, slash ? slash + 1 : name, H5P_DEFAULT)) > 0;
  hid_t holder = is_attribute ? TRY(H5Aopen_by_name(object, group, slash ? slash + 1 : name, H5P_DEFAULT, H5P_DEFAULT))
                              : TRY(H5Dopen2(object, name, H5P_DEFAULT));
  hid_t type = is_attribute ? TRY(H5Aget_type(holder)) : TRY(H5Dget_type(holder));
  hid_t space = is_attribute ? TRY(H5Aget_space(holder)) : TRY(H5Dget_space(holder));
  if ((TRY(H5Tget_class(type)) == H5T_STRING) != (kind == as_text) || TRY(H5Sget_simple_extent_npoints(space)) != 1) h5->status = -1;
  if (kind == as_text && TRY(H5Tis_variable_str(type)) <= 0) h5->status = -1;
  if (h5->status >= 0) {
    hid_t memory_type = kind == as_text ? type : H5T_NATIVE_DOUBLE;
    void *value = kind == as_text ? (void *)&text : (void *)number;
    if (is_attribute) TRY(H5Aread(holder, memory_type, value));
    else TRY(H5Dread(holder, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, value));
  }
  release(space, h5);
  release(type, h5);
  release(holder, h5);
  return text;
}

/* Datasets with rows. */

static int rank_of(const dataset *table) { return table->row_length > 0 ? 2 : 1; }

/* Create a dataset with the rows of `made`, which are `fill`, and the groups on its path. Columns of numbers have no cache: their
   chunks are written whole, but for the last. */
void dst_h5_create_dataset(hid_t group, const char *words, int kind, int64_t chunk_rows, _Bool is_scale, double fill,
                           dataset *made, sequence *h5) {
  const hsize_t longest_chunk = 16384; /* values of a row */
  const size_t slots = 7;
  hsize_t length = made->row_length, sides[] = {made->rows, length}, largest[] = {H5S_UNLIMITED, length};
  hsize_t chunk[] = {(hsize_t)chunk_rows, length < longest_chunk ? length : longest_chunk};
  hid_t type = type_of(kind, h5), space = TRY(H5Screate_simple(rank_of(made), sides, largest));
  hid_t creation = TRY(H5Pcreate(H5P_DATASET_CREATE)), access = TRY(H5Pcreate(H5P_DATASET_ACCESS));
  hid_t links = TRY(H5Pcreate(H5P_LINK_CREATE));
  TRY(H5Pset_create_intermediate_group(links, 1));
  TRY(H5Pset_chunk(creation, rank_of(made), chunk));
  if (kind != as_text) TRY(H5Pset_fill_value(creation, H5T_NATIVE_DOUBLE, &fill));
  if (kind != as_text && length == 0) TRY(H5Pset_chunk_cache(access, slots, 0, 1.0));
  made->id = TRY(H5Dcreate2(group, words, type, space, links, creation, access));
  release(space, h5);
  release(creation, h5);
  release(access, h5);
  release(links, h5);
  release(type, h5);
  describe(made->id, words, h5);
  const char *slash = strrchr(words, '/');
  if (is_scale) TRY(H5DSset_scale(made->id, slash ? slash + 1 : words));
}

/* Open an existing dataset with rows of found->row_length, and count them. Its values are read without a cache. */
void dst_h5_open_dataset(hid_t group, const char *name, dataset *found, sequence *h5) {
  hid_t access = TRY(H5Pcreate(H5P_DATASET_ACCESS));
  TRY(H5Pset_chunk_cache(access, 7, 0, 1.0));
  found->id = TRY(H5Dopen2(group, name, access));
  hid_t space = TRY(H5Dget_space(found->id));
  if (TRY(H5Sget_simple_extent_ndims(space)) != rank_of(found)) h5->status = -1;
  int64_t points = TRY(H5Sget_simple_extent_npoints(space));
  found->rows = h5->status < 0 ? 0 : (hsize_t)points / (found->row_length ? found->row_length : 1);
  release(access, h5);
  release(space, h5);
}

/* Write or read the rows of a dataset after its first ones; it grows if they are new. */
static void move_rows(int writes, dataset *table, int64_t first, int64_t rows, hid_t memory_type, void *values, sequence *h5) {
  hsize_t from[] = {(hsize_t)first, 0}, sides[] = {(hsize_t)rows, table->row_length}, grown[] = {from[0] + sides[0], sides[1]};
  if (writes && grown[0] > table->rows && TRY(H5Dset_extent(table->id, grown)) >= 0) table->rows = grown[0];
  hid_t in_file = TRY(H5Dget_space(table->id)), in_memory = TRY(H5Screate_simple(rank_of(table), sides, NULL));
  TRY(H5Sselect_hyperslab(in_file, H5S_SELECT_SET, from, NULL, sides, NULL));
  hid_t transfer = transfer_of(sides[0] * (sides[1] ? sides[1] : 1), h5);
  if (writes) TRY(H5Dwrite(table->id, memory_type, in_memory, in_file, transfer, values));
  else TRY(H5Dread(table->id, memory_type, in_memory, in_file, transfer, values));
  release(in_memory, h5);
  release(in_file, h5);
  release(transfer, h5);
}

void dst_h5_write_rows(dataset *table, int64_t first, int64_t rows, double *values, sequence *h5) {
  if (rows > 0 && h5->status >= 0) move_rows(1, table, first, rows, H5T_NATIVE_DOUBLE, values, h5);
}

void dst_h5_read_rows(dataset *table, int64_t first, int64_t rows, double *values, sequence *h5) {
  if (rows > 0 && h5->status >= 0) move_rows(0, table, first, rows, H5T_NATIVE_DOUBLE, values, h5);
}

/* Append one text: a row. */
void dst_h5_append_text(dataset *table, const char *text, sequence *h5) {
  hid_t type = type_of(as_text, h5);
  move_rows(1, table, (int64_t)table->rows, 1, type, &text, h5);
  release(type, h5);
}

/* The text of a row. */
const char *dst_h5_text(dataset *table, int64_t row, sequence *h5) {
  const char *text = NULL;
  hid_t type = type_of(as_text, h5);
  move_rows(0, table, row, 1, type, &text, h5);
  release(type, h5);
  return text;
}

/* Make a scale the coordinate of a dataset along a dimension: 0, the one that grows, or 1, along the rows. */
void dst_h5_attach_scale(const dataset *table, const dataset *scale, int side, sequence *h5) {
  TRY(H5DSattach_scale(table->id, scale->id, (unsigned)side));
}
