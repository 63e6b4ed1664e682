!> How much room a disk has. POSIX.
module dst_disk_space
  use, intrinsic :: iso_c_binding, only: c_int, c_int64_t, c_long, c_char, c_null_char
  use dst_kinds, only: wp
  implicit none
  private

  public :: free_space

  !> statvfs_t of Linux: the first members, and room for the others.
  type, bind(c) :: file_system_t
    integer(c_long) :: block_size = 0, fragment_size = 0
    integer(c_int64_t) :: blocks = 0, free_blocks = 0, available_blocks = 0
    integer(c_int64_t) :: others(16) = 0
  end type file_system_t

  interface
    integer(c_int) function c_statvfs(path, file_system) bind(c, name='statvfs')
      import :: c_int, c_char, file_system_t
      character(c_char), intent(in) :: path(*)
      type(file_system_t), intent(inout) :: file_system
    end function c_statvfs
  end interface

contains

  !> Bytes that may still be written in a folder; `huge` if the file system does not tell. Quotas are not known.
  real(wp) function free_space(folder)
    character(*), intent(in) :: folder
    type(file_system_t) :: file_system

    free_space = huge(free_space)
    if (c_statvfs(folder//c_null_char, file_system) /= 0) return
    if (file_system%blocks <= 0) return
    free_space = real(file_system%available_blocks, wp)*real(file_system%fragment_size, wp)
  end function free_space
end module dst_disk_space
