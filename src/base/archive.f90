!> The state of a run as a row of 64-bit words: from which it is resumed.
!>
!> State is plain data: what evolves in a type stands in one component, or in the type that it extends, without pointers and
!> allocatable arrays, and is saved as it lies in memory. A type that has more has one procedure `serialise(archive)`. The archive
!> either takes the data or gives them back, so that saving and loading cannot differ in their order. A word with its size precedes
!> each item, so that a row saved from other data is recognised.
module dst_archive
  use, intrinsic :: iso_c_binding, only: c_ptr, c_loc, c_f_pointer
  use, intrinsic :: iso_fortran_env, only: int32
  use dst_kinds, only: int64
  implicit none
  private

  public :: archive_t, archive_of

  !> The words of a state so far, or those that are still to be given back.
  type :: archive_t
    private
    logical :: loading = .false.
    logical :: fits = .true.                    !! every item that was asked for was there
    integer(int64), allocatable :: kept(:)      !! valid up to `used`
    integer :: used = 0                         !! number of words saved, or given back, so far
  contains
    procedure :: serialise
    procedure :: words
    procedure :: is_loading
    procedure :: given_back
  end type archive_t

  !> Units in which data are copied: the least size of an item, and how many are one word.
  integer, parameter :: unit_bits = 32, units_per_word = 2

contains

  !> An archive that gives back what `words` holds.
  pure subroutine archive_of(words, archive)
    integer(int64), intent(in) :: words(:)
    type(archive_t), intent(out) :: archive

    archive%loading = .true.
    archive%kept = words
  end subroutine archive_of

  !> The words saved so far.
  pure function words(self)
    class(archive_t), intent(in) :: self
    ! Allocatable: the words may need more room than a stack has.
    integer(int64), allocatable :: words(:)

    allocate (words(self%used))
    if (self%used > 0) words(:) = self%kept(:self%used)
  end function words

  pure logical function is_loading(self)
    class(archive_t), intent(in) :: self

    is_loading = self%loading
  end function is_loading

  !> Whether all items were there, and nothing else.
  pure logical function given_back(self)
    class(archive_t), intent(in) :: self

    given_back = self%loading .and. self%fits .and. self%used == size(self%kept)
  end function given_back

  !> Save `count` consecutive items of plain data, by default one, or give them back; if they are not there, nothing changes.
  subroutine serialise(self, place, bits, count)
    class(archive_t), intent(inout), target :: self
    type(c_ptr), intent(in) :: place              !! address of the first item
    integer, intent(in) :: bits                   !! size of an item
    integer, intent(in), optional :: count
    integer(int64), allocatable :: larger(:)
    integer(int32), pointer :: here(:), there(:)
    integer :: units, first, last, i

    units = bits/unit_bits
    if (present(count)) units = units*count
    first = self%used + 2
    last = self%used + 1 + (units + units_per_word - 1)/units_per_word
    if (self%loading) then
      if (self%fits) self%fits = last <= size(self%kept)
      if (self%fits) self%fits = self%kept(first - 1) == units
      if (.not. self%fits) return
    else
      if (.not. allocated(self%kept)) allocate (self%kept(0))
      if (last > size(self%kept)) then
        allocate (larger(2*last), source=0_int64)
        larger(:self%used) = self%kept(:self%used)
        call move_alloc(larger, self%kept)
      end if
      self%kept(first - 1) = units
    end if
    self%used = last
    if (units == 0) return
    call c_f_pointer(place, there, [units])
    call c_f_pointer(c_loc(self%kept(first)), here, [units])
    ! One by one: as a whole they would be copied on the stack, as pointers might overlap.
    do i = 1, units
      if (self%loading) then
        there(i) = here(i)
      else
        here(i) = there(i)
      end if
    end do
  end subroutine serialise
end module dst_archive
