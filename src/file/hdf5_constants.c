/* HDF5's types and classes of properties are variables of its library, which H5open sets. Fortran cannot name a variable that a shared
   library defines, so they are copied. */

#include <stdint.h>

extern int64_t H5T_C_S1_g, H5T_IEEE_F64LE_g, H5T_NATIVE_DOUBLE_g, H5T_NATIVE_INT_g, H5T_STD_I8LE_g, H5T_STD_I32LE_g,
  H5T_STD_I64LE_g, H5P_CLS_DATASET_ACCESS_ID_g, H5P_CLS_DATASET_CREATE_ID_g, H5P_CLS_DATASET_XFER_ID_g,
  H5P_CLS_FILE_ACCESS_ID_g;
extern int H5open(void);

int64_t h5t_c_s1, h5t_ieee_f64le, h5t_native_double, h5t_native_int, h5t_std_i8le, h5t_std_i32le, h5t_std_i64le,
  h5p_dataset_access, h5p_dataset_create, h5p_dataset_xfer, h5p_file_access;

int dst_h5open(void)
{
  int status = H5open();

  h5t_c_s1 = H5T_C_S1_g;
  h5t_ieee_f64le = H5T_IEEE_F64LE_g;
  h5t_native_double = H5T_NATIVE_DOUBLE_g;
  h5t_native_int = H5T_NATIVE_INT_g;
  h5t_std_i8le = H5T_STD_I8LE_g;
  h5t_std_i32le = H5T_STD_I32LE_g;
  h5t_std_i64le = H5T_STD_I64LE_g;
  h5p_dataset_access = H5P_CLS_DATASET_ACCESS_ID_g;
  h5p_dataset_create = H5P_CLS_DATASET_CREATE_ID_g;
  h5p_dataset_xfer = H5P_CLS_DATASET_XFER_ID_g;
  h5p_file_access = H5P_CLS_FILE_ACCESS_ID_g;
  return status;
}
