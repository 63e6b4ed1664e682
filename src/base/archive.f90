!> The state of a run as a row of 64-bit words: from which it is resumed.
!>
!> A type that has a state has one procedure `serialise(archive)`, which names each field once. The archive either takes the fields'
!> values or gives them back, so that saving and loading cannot differ in their order. A word with its kind and length precedes each
!> item, so that a row saved from other fields is recognised.
module dst_archive
  use dst_kinds, only: wp, int64
  implicit none
  private

  public :: archive_t, archive_of

  !> The state of a run as a list of 64-bit words; each type puts its fields in or takes them out with one procedure `serialise`.
  type :: archive_t
    private
    logical :: loading = .false.
    logical :: fits = .true.                    !! every item that was asked for was there
    integer(int64), allocatable :: kept(:)      !! valid up to `used`
    integer :: used = 0                         !! number of words saved, or given back, so far
  contains
    !> Save a value or array, or give it back; if it is not there, nothing changes.
    generic :: serialise => serialise_real, serialise_reals, serialise_matrix, serialise_integer, serialise_long, serialise_longs, &
      serialise_logical
    procedure :: words
    procedure :: is_loading
    procedure :: given_back
    procedure, private :: serialise_real, serialise_reals, serialise_matrix, serialise_integer, serialise_long, serialise_longs, &
      serialise_logical, serialise_words
  end type archive_t

  integer, parameter :: real_kind = 1, integer_kind = 2, logical_kind = 3
  integer, parameter :: words_per_real = storage_size(1.0_wp)/storage_size(1_int64)

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

  subroutine serialise_real(self, value)
    class(archive_t), intent(inout) :: self
    real(wp), intent(inout) :: value
    integer(int64) :: item(words_per_real)

    item = transfer(value, item)
    call self%serialise_words(real_kind, item)
    value = transfer(item, value)
  end subroutine serialise_real

  subroutine serialise_reals(self, values)
    class(archive_t), intent(inout) :: self
    real(wp), intent(inout) :: values(:)
    integer(int64) :: items(words_per_real*size(values))

    items = transfer(values, items)
    call self%serialise_words(real_kind, items)
    values = transfer(items, values)
  end subroutine serialise_reals

  subroutine serialise_matrix(self, values)
    class(archive_t), intent(inout) :: self
    real(wp), intent(inout) :: values(:, :)
    integer :: j

    do j = 1, size(values, 2)
      call self%serialise_reals(values(:, j))
    end do
  end subroutine serialise_matrix

  subroutine serialise_integer(self, value)
    class(archive_t), intent(inout) :: self
    integer, intent(inout) :: value
    integer(int64) :: item(1)

    item = int(value, int64)
    call self%serialise_words(integer_kind, item)
    if (abs(item(1)) <= int(huge(value), int64)) value = int(item(1))
  end subroutine serialise_integer

  subroutine serialise_long(self, value)
    class(archive_t), intent(inout) :: self
    integer(int64), intent(inout) :: value
    integer(int64) :: item(1)

    item = value
    call self%serialise_words(integer_kind, item)
    value = item(1)
  end subroutine serialise_long

  subroutine serialise_longs(self, values)
    class(archive_t), intent(inout) :: self
    integer(int64), intent(inout) :: values(:)

    call self%serialise_words(integer_kind, values)
  end subroutine serialise_longs

  subroutine serialise_logical(self, value)
    class(archive_t), intent(inout) :: self
    logical, intent(inout) :: value
    integer(int64) :: item(1)

    item = merge(1_int64, 0_int64, value)
    call self%serialise_words(logical_kind, item)
    value = item(1) /= 0
  end subroutine serialise_logical

  !> One item after the word that describes it.
  subroutine serialise_words(self, kind, item)
    class(archive_t), intent(inout) :: self
    integer, intent(in) :: kind
    integer(int64), intent(inout) :: item(:)
    integer(int64), allocatable :: larger(:)
    integer(int64) :: description
    integer :: first, last

    description = ior(shiftl(int(kind, int64), 32), int(size(item), int64))
    first = self%used + 2
    last = self%used + 1 + size(item)
    if (self%loading) then
      if (self%fits) self%fits = last <= size(self%kept)
      if (self%fits) self%fits = self%kept(first - 1) == description
      if (.not. self%fits) return
      item = self%kept(first:last)
    else
      if (.not. allocated(self%kept)) allocate (self%kept(0))
      if (last > size(self%kept)) then
        allocate (larger(2*last))
        larger(:self%used) = self%kept(:self%used)
        call move_alloc(larger, self%kept)
      end if
      self%kept(first - 1) = description
      self%kept(first:last) = item
    end if
    self%used = last
  end subroutine serialise_words
end module dst_archive
