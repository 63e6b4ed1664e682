!> A deck that has been read: the values of all keys of the schema, and who set them.
module dst_deck_values
  use dst_kinds, only: wp, int64
  use dst_faults, only: faults_t, place_t
  use dst_text, only: read_real, has_word
  use dst_schema, only: key_t, schema, key_count, sweep_group, find_key, find_name, longest_text, is_text, &
                        condition_count, automatic, is_word_of
  use dst_writer, only: absent
  implicit none
  private

  public :: deck_t, value_t, usage, failing_condition, element_count, set_default, is_default, used

  !> What `usage` says of a key that has a meaning in this deck, and of one whose meaning hangs on a faulty choice.
  integer, parameter :: used = 0, unknown = -1

  !> The value of a key, and where it comes from. Of the two lists one is empty.
  type :: value_t
    logical :: user = .false.        !! set by the deck or by a setting, not the default
    logical :: attempted = .false.   !! the deck tries to set it, perhaps under a wrong name
    logical :: valid = .true.        !! the given value could be understood
    type(place_t) :: place
    real(wp), allocatable :: reals(:)   !! whole numbers, too
    character(longest_text), allocatable :: texts(:)
  end type value_t

  !> The values in the order of the schema. A deck without error has a value for every key that it uses.
  type :: deck_t
    character(:), allocatable :: name    !! the file's name as given
    character(:), allocatable :: text    !! the file's text as read
    type(value_t) :: value(key_count)
    type(faults_t) :: faults             !! what is wrong with it
    type(faults_t) :: notes              !! what was left out of it
  contains
    procedure :: real_of
    procedure :: reals_of
    procedure :: integer_of
    procedure :: text_of
    procedure :: texts_of
    procedure :: is_set
    procedure :: is_used
    procedure :: is_sweep
    procedure :: refuse
  end type deck_t

contains

  !> Value of a real key [unit of the schema]; NaN if it has none, like an unused key without default.
  pure real(wp) function real_of(self, group, key)
    class(deck_t), intent(in) :: self
    character(*), intent(in) :: group, key

    real_of = absent()
    associate (reals => self%value(find_key(group, key))%reals)
      if (size(reals) > 0) real_of = reals(1)
    end associate
  end function real_of

  pure function reals_of(self, group, key) result(list)
    class(deck_t), intent(in) :: self
    character(*), intent(in) :: group, key
    real(wp), allocatable :: list(:)

    list = self%value(find_key(group, key))%reals
  end function reals_of

  pure integer(int64) function integer_of(self, group, key)
    class(deck_t), intent(in) :: self
    character(*), intent(in) :: group, key

    integer_of = nint(self%real_of(group, key), int64)
  end function integer_of

  pure function text_of(self, group, key) result(text)
    class(deck_t), intent(in) :: self
    character(*), intent(in) :: group, key
    character(:), allocatable :: text

    text = trim(self%value(find_key(group, key))%texts(1))
  end function text_of

  pure function texts_of(self, group, key) result(list)
    class(deck_t), intent(in) :: self
    character(*), intent(in) :: group, key
    character(longest_text), allocatable :: list(:)

    list = self%value(find_key(group, key))%texts
  end function texts_of

  !> Whether the user set the key.
  pure logical function is_set(self, group, key)
    class(deck_t), intent(in) :: self
    character(*), intent(in) :: group, key

    is_set = self%value(find_key(group, key))%user
  end function is_set

  !> Whether the key has a meaning with the deck's model, law, contact and method.
  pure logical function is_used(self, group, key)
    class(deck_t), intent(in) :: self
    character(*), intent(in) :: group, key

    is_used = usage(self, find_key(group, key)) == used
  end function is_used

  !> Whether the deck is a sweep of many cases.
  pure logical function is_sweep(self)
    class(deck_t), intent(in) :: self

    is_sweep = any(self%value%user .and. schema%group == sweep_group)
  end function is_sweep

  !> Note what is wrong with the value of a key.
  subroutine refuse(self, group, key, text)
    class(deck_t), intent(inout) :: self
    character(*), intent(in) :: group, key, text

    call self%faults%add(self%value(find_key(group, key))%place, text)
  end subroutine refuse

  !> Whether key `i` is `used`: all its conditions are true, and the keys that they name are used themselves. Otherwise the key
  !> whose value is the reason why it is not, or `unknown` as long as a value is faulty on which that hangs.
  pure recursive function usage(deck, i) result(key)
    type(deck_t), intent(in) :: deck
    integer, intent(in) :: i
    integer :: key
    integer :: n, on, its

    key = used
    do n = 1, condition_count(schema(i))
      on = find_name(schema(i)%used_by(n)%on)
      its = usage(deck, on)
      if (its == unknown .or. (its == used .and. .not. deck%value(on)%valid)) then
        key = unknown
      else if (its > used) then
        key = its
        return
      else if (.not. has_word(schema(i)%used_by(n)%choices, trim(deck%value(on)%texts(1)))) then
        key = on
        return
      end if
    end do
  end function usage

  !> The reason why key `i` is not used: 'law constant'.
  pure function failing_condition(deck, i) result(text)
    type(deck_t), intent(in) :: deck
    integer, intent(in) :: i
    character(:), allocatable :: text
    integer :: on

    on = usage(deck, i)
    text = ''
    if (on > used) text = trim(schema(on)%name)//' '//trim(deck%value(on)%texts(1))
  end function failing_condition

  !> Number of values of a key.
  pure integer function element_count(value)
    type(value_t), intent(in) :: value

    element_count = size(value%reals) + size(value%texts)
  end function element_count

  !> Reset a key to its default.
  pure subroutine set_default(key, value)
    type(key_t), intent(in) :: key
    type(value_t), intent(out) :: value
    character(:), allocatable :: problem

    value%texts = spread(key%default, 1, merge(1, 0, is_text(key)))
    allocate (value%reals(merge(0, 1, is_text(key) .or. key%default == '')), source=automatic)
    if (size(value%reals) == 1 .and. .not. is_word_of(key, trim(key%default))) &
      call read_real(trim(key%default), value%reals(1), problem)
  end subroutine set_default

  !> Whether the value is the schema's default; for an unused key, the value that switches it off.
  pure logical function is_default(key, value)
    type(key_t), intent(in) :: key
    type(value_t), intent(in) :: value
    type(value_t) :: standard

    call set_default(key, standard)
    is_default = element_count(value) == element_count(standard) .and. element_count(value) > 0
    if (is_default) is_default = all(value%texts == standard%texts) .and. .not. any(abs(value%reals - standard%reals) > 0.0_wp)
  end function is_default
end module dst_deck_values
