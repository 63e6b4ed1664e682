!> What must hold for any deck whatever.
module deck_oracle
  use dst_kinds, only: wp
  use dst_errors, only: error_t, deck_error
  use dst_schema, only: schema, key_count, longest_text, real_kind, reals_kind, integer_kind
  use dst_deck, only: deck_t, parse_deck, resolved
  use dst_deck_values, only: value_t, usage, used
  use dst_scene, only: scene_t, scene_from_deck
  use fuzz_cases, only: case_t
  implicit none
  private

  public :: verdict_t, examine

  type :: verdict_t
    logical :: accepted = .false.
    character(600) :: failure = ''
  end type verdict_t

  character(*), parameter :: name = 'deck.nml'
  character(*), parameter :: no_settings(0) = [character(1) ::]
  character, parameter :: newline = achar(10)

contains

  !> Read the case's deck; `verdict%failure` says what does not hold, or is ''.
  subroutine examine(case, verdict)
    type(case_t), intent(in) :: case
    type(verdict_t), intent(out) :: verdict
    type(deck_t), allocatable :: deck
    type(error_t), allocatable :: error
    type(scene_t) :: scene

    allocate (deck)
    call parse_deck(case%deck, name, case%settings(:case%setting_count), deck, error)
    verdict%accepted = .not. allocated(error)
    if (verdict%accepted) then
      call scene_from_deck(deck, scene)
      call check_fixpoint(deck, verdict%failure)
    else
      call check_message(error, verdict%failure)
    end if
  end subroutine examine

  !> A refusal has its code, and lines that name their place and cannot upset a terminal.
  subroutine check_message(error, failure)
    type(error_t), intent(in) :: error
    character(*), intent(inout) :: failure
    integer :: first, width, i

    if (error%code /= deck_error) failure = 'refused with another code'
    if (error%text == '') failure = 'refused without a word'
    first = 1
    do while (first <= len(error%text))
      width = index(error%text(first:)//newline, newline) - 1
      associate (line => error%text(first:first + width - 1))
        if (index(line, name) /= 1 .and. index(line, '--set ') /= 1) failure = 'a message without its place: '//line
        do i = 1, len(line)
          if (iachar(line(i:i)) < 32 .or. iachar(line(i:i)) == 127) failure = 'control characters in a message'
        end do
      end associate
      first = first + width + 1
    end do
  end subroutine check_message

  !> The resolved deck reads back to the same values of all keys that are used.
  subroutine check_fixpoint(deck, failure)
    type(deck_t), intent(in) :: deck
    character(*), intent(inout) :: failure
    type(deck_t), allocatable :: again
    type(error_t), allocatable :: error
    integer :: i

    allocate (again)
    call parse_deck(resolved(deck), name, no_settings, again, error)
    if (allocated(error)) then
      failure = 'accepted, but resolved it is refused: '//error%text
      return
    end if
    do i = 1, key_count
      if (usage(deck, i) /= usage(again, i)) then
        failure = trim(schema(i)%name)//' is used once and not the other time'
      else if (usage(deck, i) == used) then
        if (.not. same(schema(i)%kind, deck%value(i), again%value(i))) &
          failure = trim(schema(i)%name)//' changes when the deck is resolved'
      end if
    end do
  end subroutine check_fixpoint

  !> The same bits.
  logical function same(kind, a, b)
    integer, intent(in) :: kind
    type(value_t), intent(in) :: a, b

    same = .false.
    select case (kind)
    case (real_kind, reals_kind, integer_kind)
      if (size(a%reals) /= size(b%reals)) return
      same = all(a%reals >= b%reals .and. a%reals <= b%reals) .and. &
             all(sign(1.0_wp, a%reals) >= sign(1.0_wp, b%reals) .and. sign(1.0_wp, a%reals) <= sign(1.0_wp, b%reals))
    case default
      if (size(a%texts) /= size(b%texts)) return
      same = all(a%texts == b%texts)
    end select
  end function same
end module deck_oracle
