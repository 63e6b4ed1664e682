!> Saved items are given back, bit for bit; a request for an item that does not exist, or is of another size, changes nothing.
program test_archive
  use, intrinsic :: iso_c_binding, only: c_loc
  use checks, only: check, finish
  use dst_kinds, only: wp, int64
  use dst_archive, only: archive_t, archive_of
  implicit none

  !> One field of every kind.
  type :: plain_t
    real(wp) :: x = 0.0_wp, y(3) = 0.0_wp, z(0:1, 2) = 0.0_wp
    integer :: i = 0
    integer(int64) :: j = 0, k(2) = 0
  end type plain_t

  type, extends(plain_t) :: state_t
    logical :: l = .false.
  end type state_t

  call test_given_back()
  call test_misfits()
  call finish()

contains

  subroutine serialise(self, archive)
    type(state_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive

    call archive%serialise(c_loc(self%plain_t), storage_size(self%plain_t))
    call archive%serialise(c_loc(self%y), storage_size(self%y), size(self%y))
    call archive%serialise(c_loc(self%y), storage_size(self%y), 0)
    call archive%serialise(c_loc(self%l), storage_size(self%l))
  end subroutine serialise

  subroutine test_given_back()
    type(archive_t) :: saved, loaded
    type(state_t) :: before, after

    before = state()
    call serialise(before, saved)
    call check('saving changes nothing', same(before, state()))
    call check('what has been saved is not loaded', .not. saved%given_back())
    call archive_of(saved%words(), loaded)
    call serialise(after, loaded)
    call check('all given back', loaded%given_back())
    call check('bit for bit', same(after, before))
  end subroutine test_given_back

  subroutine test_misfits()
    type(archive_t) :: saved, loaded
    type(state_t) :: before, after
    integer(int64), allocatable :: words(:)
    real(wp), target :: x(2)

    before = state()
    call serialise(before, saved)
    words = saved%words()
    call archive_of(words(:size(words) - 1), loaded)
    call serialise(after, loaded)
    call check('a word too few', .not. loaded%given_back())
    call check('the last field is as it was', .not. after%l)
    call archive_of([words, 0_int64], loaded)
    call serialise(after, loaded)
    call check('a word too many', .not. loaded%given_back())

    call archive_of(words, loaded)
    x = 5.0_wp
    call loaded%serialise(c_loc(x), storage_size(x), size(x))
    call check('another size', .not. loaded%given_back() .and. all(abs(x - 5.0_wp) <= 0.0_wp))
    call archive_of(words(:0), loaded)
    call serialise(after, loaded)
    call check('nothing there', .not. loaded%given_back())
  end subroutine test_misfits

  function state()
    type(state_t) :: state

    state%x = -0.0_wp
    state%y = [tiny(1.0_wp)/8.0_wp, huge(1.0_wp), 1.0_wp/3.0_wp]
    state%z = reshape([1.0_wp, 2.0_wp, 3.0_wp, 4.0_wp], [2, 2])
    state%i = -7
    state%j = -huge(1_int64)
    state%k = [1_int64, 2_int64]**40
    state%l = .true.
  end function state

  logical function same(a, b)
    type(state_t), intent(in) :: a, b

    same = all(bits([a%x, a%y]) == bits([b%x, b%y])) .and. all(abs(a%z - b%z) <= 0.0_wp) .and. a%i == b%i .and. a%j == b%j &
      .and. all(a%k == b%k) .and. (a%l .eqv. b%l)
  end function same

  pure elemental integer(int64) function bits(x)
    real(wp), intent(in) :: x

    bits = transfer(x, bits)
  end function bits
end program test_archive
