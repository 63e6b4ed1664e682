!> Eigenvalues of a small real matrix, by LAPACK in double precision, whatever the working precision is.
module dst_eigenvalues
  use dst_kinds, only: wp, real64
  implicit none
  private

  public :: find_eigenvalues

  interface
    subroutine dgeev(jobvl, jobvr, n, a, lda, wr, wi, vl, ldvl, vr, ldvr, work, lwork, info)
      import :: real64
      character, intent(in) :: jobvl, jobvr
      integer, intent(in) :: n, lda, ldvl, ldvr, lwork
      real(real64), intent(inout) :: a(lda, *)
      real(real64), intent(out) :: wr(*), wi(*), vl(ldvl, *), vr(ldvr, *), work(*)
      integer, intent(out) :: info
    end subroutine dgeev
  end interface

contains

  !> The eigenvalues of a square matrix; of a conjugate pair the positive imaginary part comes first. `found`: not if a number is
  !> not finite, or LAPACK fails.
  subroutine find_eigenvalues(matrix, eigenvalues, found)
    real(wp), intent(in) :: matrix(:, :)
    complex(wp), intent(out) :: eigenvalues(:)
    logical, intent(out) :: found
    real(real64) :: double_matrix(size(matrix, 1), size(matrix, 1)), left(1, 1), right(1, 1), work(16*size(matrix, 1))
    real(real64), dimension(size(matrix, 1)) :: real_part, imaginary_part
    integer :: n, info

    n = size(matrix, 1)
    double_matrix = real(matrix, real64)
    eigenvalues = (0.0_wp, 0.0_wp)
    ! LAPACK stops the program if a number is not finite.
    info = 1
    if (all(abs(double_matrix) <= huge(1.0_real64))) &
      call dgeev('N', 'N', n, double_matrix, n, real_part, imaginary_part, left, 1, right, 1, work, size(work), info)
    found = info == 0
    if (found) eigenvalues = cmplx(real_part, imaginary_part, wp)
  end subroutine find_eigenvalues
end module dst_eigenvalues
