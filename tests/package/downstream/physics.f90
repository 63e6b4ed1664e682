!> Calls the physics alone: the critical misalignment of Fig. 3's object [deg], below which steady sliding is unstable.
program physics
  use dst_errors, only: error_t
  use dst_friction, only: new_friction_law
  use dst_kinds, only: wp, pi
  use dst_slider, only: slider_t
  use dst_stability, only: critical_t, critical_misalignment, low_branch
  implicit none

  type(slider_t) :: slider
  type(critical_t) :: critical
  type(error_t), allocatable :: error

  slider%mass = 0.25_wp
  slider%stiffness = [1.0e3_wp, 1.0e7_wp]
  call new_friction_law('weakening', mu_0=0.20_wp, mu_inf=0.15_wp, v_f=0.010_wp, normal_load=10.0_wp, law=slider%law)
  call critical_misalignment(slider, 1.0e-3_wp, critical, error)
  if (allocated(error)) then
    print '(a)', error%text
    error stop 1
  end if
  print '(a, f19.14, a)', 'phi_c =', critical%angle(low_branch)*180.0_wp/pi, ' deg'
end program physics
