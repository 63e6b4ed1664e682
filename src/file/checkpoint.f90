!> The file from which a run is resumed: FILE.h5.checkpoint next to the result FILE.h5.
!>
!> Lines of text say what the file is and to which run it belongs; then follow the deck and the words of the state (dst_archive), 8
!> bytes each in the machine's order; the last line is the SHA-256 of everything before it. The file is always replaced as a whole.
!> Together with the numbers in the result file's columns it is all that is needed to resume the run.
module dst_checkpoint
  use dst_kinds, only: int64
  use dst_disk, only: read_bytes
  use dst_errors, only: error_t, raise, file_error
  use dst_sha256, only: sha256
  use dst_text, only: integer_text, value_in
  implicit none
  private

  public :: provenance_t, checkpoint_t, checkpoint_name, is_checkpoint, encoded, read_checkpoint

  !> Identity of the run.
  type :: provenance_t
    character(:), allocatable :: version, git_revision, compiler   !! of the program that began the run
    character(:), allocatable :: created           !! when the run began: ISO 8601, UTC
    character(:), allocatable :: deck_text         !! the deck as read
    character(:), allocatable :: deck_resolved     !! every key as used: --set makes a different deck
    character(:), allocatable :: deck_sha256       !! of the deck as read
  end type provenance_t

  !> Contents of a checkpoint: the run to which it belongs, the extent of the result file then, the state.
  type, extends(provenance_t) :: checkpoint_t
    character(:), allocatable :: result_checksum   !! in the seal of a run that was stopped; '-' while it is running
    integer(int64), allocatable :: words(:)        !! the state
  end type checkpoint_t

  character(*), parameter :: signature = 'dynstiction checkpoint, format '
  !> Version of this format and of the fields that the types of a run put into an archive.
  character(*), parameter :: format_version = '11'
  character, parameter :: n = achar(10)
  integer, parameter :: word_bytes = 8, most_bytes = 2**27, digest_length = 64

contains

  !> The name of a result's checkpoint.
  pure function checkpoint_name(result_file) result(name)
    character(*), intent(in) :: result_file
    character(:), allocatable :: name

    name = result_file//'.checkpoint'
  end function checkpoint_name

  !> Whether a file begins like a checkpoint of any format.
  logical function is_checkpoint(file_name)
    character(*), intent(in) :: file_name
    character(:), allocatable :: bytes, reason

    call read_bytes(file_name, most_bytes, bytes, reason)
    is_checkpoint = .false.
    if (.not. allocated(reason)) is_checkpoint = index(bytes, signature) == 1
  end function is_checkpoint

  !> The bytes of a checkpoint file.
  function encoded(checkpoint) result(bytes)
    type(checkpoint_t), intent(in) :: checkpoint
    character(:), allocatable :: bytes, state
    integer :: i

    ! Word by word: all words together may need more room than a stack has.
    allocate (character(word_bytes*size(checkpoint%words)) :: state)
    do i = 1, size(checkpoint%words)
      state(word_bytes*(i - 1) + 1:word_bytes*i) = transfer(checkpoint%words(i), repeat(' ', word_bytes))
    end do
    bytes = signature//format_version//n//'version '//checkpoint%version//n//'git_revision '//checkpoint%git_revision//n// &
      'compiler '//checkpoint%compiler//n//'deck_sha256 '//checkpoint%deck_sha256//n//'created '//checkpoint%created//n// &
      'result_checksum '//checkpoint%result_checksum//n// &
      part('deck', checkpoint%deck_text)//part('deck_resolved', checkpoint%deck_resolved)//part('state', state)
    bytes = bytes//'sha256 '//sha256(bytes)//n
  end function encoded

  !> Read the checkpoint of `result_file`; an incomplete one, or one of another format, is refused.
  subroutine read_checkpoint(result_file, shown_name, checkpoint, error)
    character(*), intent(in) :: result_file, shown_name   !! its path; its name in messages
    type(checkpoint_t), intent(out) :: checkpoint
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: bytes, reason

    call read_bytes(checkpoint_name(result_file), most_bytes, bytes, reason)
    if (.not. allocated(reason)) call check_format(bytes, reason)
    if (.not. allocated(reason)) call check_digest(bytes, reason)
    if (.not. allocated(reason)) call take_apart(bytes, checkpoint, reason)
    if (allocated(reason)) call raise(error, file_error, checkpoint_name(shown_name)//': no checkpoint to resume from: '// &
      reason//': run the deck again')
  end subroutine read_checkpoint

  pure subroutine check_format(bytes, reason)
    character(*), intent(in) :: bytes
    character(:), allocatable, intent(out) :: reason
    integer, parameter :: longest = len(signature) + 20
    character(:), allocatable :: found

    found = bytes(:index(bytes(:min(len(bytes), longest)), n))
    reason = 'it does not begin like one'
    if (index(found, signature) /= 1 .or. len(found) <= len(signature) + 1) return
    found = found(len(signature) + 1:len(found) - 1)
    if (verify(found, '0123456789') > 0) return
    if (found == format_version) then
      deallocate (reason)
    else
      reason = 'it is of format '//found//', this program reads format '//format_version
    end if
  end subroutine check_format

  !> The last line is the digest of everything before it.
  pure subroutine check_digest(bytes, reason)
    character(*), intent(in) :: bytes
    character(:), allocatable, intent(out) :: reason
    integer :: last

    last = len(bytes) - len('sha256 ') - digest_length - 1
    reason = 'it is damaged'
    if (last < 1) return
    if (bytes(last + 1:) == 'sha256 '//sha256(bytes(:last))//n) deallocate (reason)
  end subroutine check_digest

  !> A line with the number of bytes, the bytes, and a line end.
  pure function part(name, content)
    character(*), intent(in) :: name, content
    character(:), allocatable :: part

    part = name//' '//integer_text(len(content, int64))//n//content//n
  end function part

  !> Assign every part. The digest has shown that all parts are as they were written.
  subroutine take_apart(bytes, checkpoint, reason)
    character(*), intent(in) :: bytes
    type(checkpoint_t), intent(inout) :: checkpoint
    character(:), allocatable, intent(out) :: reason
    character(:), allocatable :: state
    integer :: next, i

    checkpoint%version = value_in(bytes, 'version')
    checkpoint%git_revision = value_in(bytes, 'git_revision')
    checkpoint%compiler = value_in(bytes, 'compiler')
    checkpoint%deck_sha256 = value_in(bytes, 'deck_sha256')
    checkpoint%created = value_in(bytes, 'created')
    checkpoint%result_checksum = value_in(bytes, 'result_checksum')
    next = index(bytes, n//'deck ') + 1
    call take_part('deck', checkpoint%deck_text)
    call take_part('deck_resolved', checkpoint%deck_resolved)
    call take_part('state', state)
    allocate (checkpoint%words(len(state)/word_bytes))
    do i = 1, size(checkpoint%words)
      checkpoint%words(i) = transfer(state(word_bytes*(i - 1) + 1:word_bytes*i), checkpoint%words(i))
    end do

  contains

    !> As many bytes as the next line says; this line must begin with `name`.
    subroutine take_part(name, content)
      character(*), intent(in) :: name
      character(:), allocatable, intent(out) :: content
      integer :: first, count, io_status

      content = ''
      if (allocated(reason)) return
      first = next + index(bytes(next:), n)
      io_status = 1
      if (index(bytes(next:first - 1), name//' ') == 1) read (bytes(next + len(name):first - 2), *, iostat=io_status) count
      if (io_status == 0) io_status = merge(0, 1, count >= 0 .and. count < len(bytes) - first)
      if (io_status == 0) then
        content = bytes(first:first + count - 1)
        next = first + count + 1
      else
        reason = 'its '//name//' is missing'
      end if
    end subroutine take_part
  end subroutine take_apart
end module dst_checkpoint
