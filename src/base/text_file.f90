!> Text files: decks, and the tables beside them.
module dst_text_file
  use dst_kinds, only: int64
  use dst_text, only: integer_text
  implicit none
  private

  public :: read_text, path_beside, hdf5_signature

  !> The first bytes of a file that is no text: a result, or another HDF5 file.
  character(*), parameter :: hdf5_signature = char(137)//'HDF'//char(13)//char(10)//char(26)//char(10)

contains

  !> The bytes of a regular file; `problem` is '' or says why they cannot be read. Of a file with more than `most` bytes these are
  !> read, which may tell what it is.
  subroutine read_text(path, most, text, problem)
    character(*), intent(in) :: path
    integer, intent(in) :: most
    character(:), allocatable, intent(out) :: text, problem
    character(256) :: message
    integer(int64) :: bytes
    integer :: unit, ios
    logical :: exists, is_folder

    text = ''
    problem = ''
    bytes = 0_int64
    exists = len_trim(path) > 0
    if (exists) inquire (file=path, exist=exists, size=bytes)
    inquire (file=path//'/.', exist=is_folder)
    if (.not. exists) then
      problem = 'no such file'
    else if (is_folder) then
      problem = 'is a folder'
    else if (bytes <= 0) then
      ! Pipes and devices have no size either, and opening one could wait forever.
      problem = 'is empty or not a regular file'
    end if
    if (problem /= '') return
    if (bytes > most) problem = integer_text(bytes)//' bytes are too many, at most '//integer_text(most)//' are read'
    open (newunit=unit, file=path, access='stream', form='unformatted', status='old', action='read', iostat=ios, iomsg=message)
    if (ios == 0) then
      text = repeat(' ', int(min(bytes, int(most, int64))))
      read (unit, iostat=ios, iomsg=message) text
      close (unit)
    end if
    if (ios /= 0) problem = 'cannot be read ('//trim(message)//')'
  end subroutine read_text

  !> The path of `name`, which is relative to the folder of `file` if it does not begin with a slash.
  pure function path_beside(file, name) result(path)
    character(*), intent(in) :: file, name
    character(:), allocatable :: path

    path = name
    if (path(1:1) /= '/') path = file(:index(file, '/', back=.true.))//path
  end function path_beside
end module dst_text_file
