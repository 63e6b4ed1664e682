!> Explicit Runge-Kutta methods as data.
!>
!>     k_i = f(z_0 + h sum_{j<i} a_ij k_j),     z_1 = z_0 + h sum_i b_i k_i.
!>
!> The stage after the last one is the slope at the end of the step, a(stages + 1, :) = b: it is the first stage of the next step
!> and is used by the dense output, in Hairer's form with e = 1 - tau:
!>
!>     z(tau) = z_0 + tau (r_1 + e (r_2 + tau (r_3 + e (r_4 + tau (r_5 + e (r_6 + tau r_7)))))),
!>     r_1 = z_1 - z_0,  r_2 = h k_1 - r_1,  r_3 = r_1 - h k_end - r_2,  r_(3+l) = h sum_i dense_il k_i.
!>
!> Without r_4... it is the cubic Hermite polynomial. Sources: Dormand & Prince (1980); Hairer,
!> Norsett & Wanner, Solving ODEs I, Sec. II.5 and II.6 and the constants published with DOP853.
module dst_runge_kutta_tableaux
  use dst_kinds, only: wp
  implicit none
  private

  public :: tableau_t, tableau_named, dense_weights, max_stages

  !> Sizes of the largest method.
  integer, parameter :: max_stages = 16, max_dense = 4, max_errors = 2

  !> An explicit method.
  type :: tableau_t
    integer :: order = 0
    !> Stages of the step itself, without the slope at its end.
    integer :: stages = 0
    !> All stages, including the slope at the end and the stages that only the dense output needs.
    integer :: all_stages = 0
    !> Embedded error estimates: none (fixed step), one, or two (DOP853: fifth order, stretched by a third).
    integer :: errors = 0
    !> Terms r_4... of the dense output, whose degree is 3 more.
    integer :: dense_terms = 0
    real(wp) :: a(max_stages, max_stages) = 0.0_wp
    real(wp) :: b(max_stages) = 0.0_wp
    real(wp) :: c(max_stages) = 0.0_wp
    real(wp) :: error(max_stages, max_errors) = 0.0_wp
    real(wp) :: dense(max_stages, max_dense) = 0.0_wp
    !> The last of these terms at its maximum: an estimate of the dense output's error.
    real(wp) :: dense_error(max_stages) = 0.0_wp
  end type tableau_t

contains

  !> The method called 'rk4', 'dopri5' or 'dop853'.
  pure function tableau_named(name) result(tableau)
    character(*), intent(in) :: name
    type(tableau_t) :: tableau

    select case (name)
    case ('rk4')
      tableau = rk4()
    case ('dop853')
      tableau = dop853()
    case default
      tableau = dopri5()
    end select
  end function tableau_named

  !> Weights of the slopes, without h, in z(tau) - z_0.
  pure function dense_weights(tableau, tau) result(weight)
    type(tableau_t), intent(in) :: tableau
    real(wp), intent(in) :: tau
    real(wp) :: weight(max_stages)
    real(wp) :: factor, start(max_stages), end(max_stages)
    integer :: l

    start = 0.0_wp
    end = 0.0_wp
    start(1) = 1.0_wp
    end(tableau%stages + 1) = 1.0_wp
    factor = tau*(1.0_wp - tau)
    weight = tau*tableau%b + factor*(start - tableau%b) + factor*tau*(2.0_wp*tableau%b - start - end)
    factor = factor*tau
    do l = 1, tableau%dense_terms
      if (modulo(l, 2) == 1) then
        factor = factor*(1.0_wp - tau)
      else
        factor = factor*tau
      end if
      weight = weight + factor*tableau%dense(:, l)
    end do
  end function dense_weights

  !> Kutta's method of order 4.
  pure function rk4() result(tableau)
    type(tableau_t) :: tableau

    tableau%order = 4
    tableau%stages = 4
    tableau%all_stages = 5
    tableau%c(2:5) = [0.5_wp, 0.5_wp, 1.0_wp, 1.0_wp]
    tableau%a(2, 1) = 0.5_wp
    tableau%a(3, 2) = 0.5_wp
    tableau%a(4, 3) = 1.0_wp
    tableau%b(1:4) = [1.0_wp/6.0_wp, 1.0_wp/3.0_wp, 1.0_wp/3.0_wp, 1.0_wp/6.0_wp]
    tableau%a(5, :) = tableau%b
  end function rk4

  !> Dormand & Prince, order 5 with an estimate of order 4.
  pure function dopri5() result(tableau)
    type(tableau_t) :: tableau

    tableau%order = 5
    tableau%stages = 6
    tableau%all_stages = 7
    tableau%errors = 1
    tableau%dense_terms = 1
    tableau%c(2:7) = [1.0_wp/5.0_wp, 3.0_wp/10.0_wp, 4.0_wp/5.0_wp, 8.0_wp/9.0_wp, 1.0_wp, 1.0_wp]
    tableau%a(2, 1) = 1.0_wp/5.0_wp
    tableau%a(3, 1:2) = [3.0_wp/40.0_wp, 9.0_wp/40.0_wp]
    tableau%a(4, 1:3) = [44.0_wp/45.0_wp, -56.0_wp/15.0_wp, 32.0_wp/9.0_wp]
    tableau%a(5, 1:4) = [19372.0_wp/6561.0_wp, -25360.0_wp/2187.0_wp, 64448.0_wp/6561.0_wp, -212.0_wp/729.0_wp]
    tableau%a(6, 1:5) = [9017.0_wp/3168.0_wp, -355.0_wp/33.0_wp, 46732.0_wp/5247.0_wp, 49.0_wp/176.0_wp, &
      -5103.0_wp/18656.0_wp]
    tableau%b(1:6) = [35.0_wp/384.0_wp, 0.0_wp, 500.0_wp/1113.0_wp, 125.0_wp/192.0_wp, -2187.0_wp/6784.0_wp, &
      11.0_wp/84.0_wp]
    tableau%a(7, :) = tableau%b
    tableau%error(1:7, 1) = [71.0_wp/57600.0_wp, 0.0_wp, -71.0_wp/16695.0_wp, 71.0_wp/1920.0_wp, &
      -17253.0_wp/339200.0_wp, 22.0_wp/525.0_wp, -1.0_wp/40.0_wp]
    tableau%dense(1:7, 1) = [-12715105075.0_wp/11282082432.0_wp, 0.0_wp, 87487479700.0_wp/32700410799.0_wp, &
      -10690763975.0_wp/1880347072.0_wp, 701980252875.0_wp/199316789632.0_wp, -1453857185.0_wp/822651844.0_wp, &
      69997945.0_wp/29380423.0_wp]
  end function dopri5

  !> Dormand & Prince's order 8 as extended by Hairer & Wanner, with dense output of order 7.
  pure function dop853() result(tableau)
    type(tableau_t) :: tableau

    tableau%order = 8
    tableau%stages = 12
    tableau%all_stages = 16
    tableau%errors = 2
    tableau%dense_terms = 4
    tableau%c(2:16) = [0.526001519587677318785587544488e-01_wp, 0.789002279381515978178381316732e-01_wp, &
      0.118350341907227396726757197510_wp, 0.281649658092772603273242802490_wp, 0.333333333333333333333333333333_wp, 0.25_wp, &
      0.307692307692307692307692307692_wp, 0.651282051282051282051282051282_wp, 0.6_wp, 0.857142857142857142857142857142_wp, &
      1.0_wp, 1.0_wp, 0.1_wp, 0.2_wp, 0.777777777777777777777777777778_wp]
    tableau%a(2, 1) = 5.26001519587677318785587544488e-2_wp
    tableau%a(3, 1:2) = [1.97250569845378994544595329183e-2_wp, 5.91751709536136983633785987549e-2_wp]
    tableau%a(4, [1, 3]) = [2.95875854768068491816892993775e-2_wp, 8.87627564304205475450678981324e-2_wp]
    tableau%a(5, [1, 3, 4]) = [2.41365134159266685502369798665e-1_wp, -8.84549479328286085344864962717e-1_wp, &
      9.24834003261792003115737966543e-1_wp]
    tableau%a(6, [1, 4, 5]) = [3.7037037037037037037037037037e-2_wp, 1.70828608729473871279604482173e-1_wp, &
      1.25467687566822425016691814123e-1_wp]
    tableau%a(7, [1, 4, 5, 6]) = [3.7109375e-2_wp, 1.70252211019544039314978060272e-1_wp, 6.02165389804559606850219397283e-2_wp, &
      -1.7578125e-2_wp]
    tableau%a(8, [1, 4, 5, 6, 7]) = [3.70920001185047927108779319836e-2_wp, 1.70383925712239993810214054705e-1_wp, &
      1.07262030446373284651809199168e-1_wp, -1.53194377486244017527936158236e-2_wp, 8.27378916381402288758473766002e-3_wp]
    tableau%a(9, [1, 4, 5, 6, 7, 8]) = [6.24110958716075717114429577812e-1_wp, -3.36089262944694129406857109825_wp, &
      -8.68219346841726006818189891453e-1_wp, 2.75920996994467083049415600797e1_wp, 2.01540675504778934086186788979e1_wp, &
      -4.34898841810699588477366255144e1_wp]
    tableau%a(10, [1, 4, 5, 6, 7, 8, 9]) = [4.77662536438264365890433908527e-1_wp, -2.48811461997166764192642586468_wp, &
      -5.90290826836842996371446475743e-1_wp, 2.12300514481811942347288949897e1_wp, 1.52792336328824235832596922938e1_wp, &
      -3.32882109689848629194453265587e1_wp, -2.03312017085086261358222928593e-2_wp]
    tableau%a(11, [1, 4, 5, 6, 7, 8, 9, 10]) = [-9.3714243008598732571704021658e-1_wp, 5.18637242884406370830023853209_wp, &
      1.09143734899672957818500254654_wp, -8.14978701074692612513997267357_wp, -1.85200656599969598641566180701e1_wp, &
      2.27394870993505042818970056734e1_wp, 2.49360555267965238987089396762_wp, -3.0467644718982195003823669022_wp]
    tableau%a(12, [1, 4, 5, 6, 7, 8, 9, 10, 11]) = [2.27331014751653820792359768449_wp, -1.05344954667372501984066689879e1_wp, &
      -2.00087205822486249909675718444_wp, -1.79589318631187989172765950534e1_wp, 2.79488845294199600508499808837e1_wp, &
      -2.85899827713502369474065508674_wp, -8.87285693353062954433549289258_wp, 1.23605671757943030647266201528e1_wp, &
      6.43392746015763530355970484046e-1_wp]
    tableau%a(13, [1, 6, 7, 8, 9, 10, 11, 12]) = [5.42937341165687622380535766363e-2_wp, 4.45031289275240888144113950566_wp, &
      1.89151789931450038304281599044_wp, -5.8012039600105847814672114227_wp, 3.1116436695781989440891606237e-1_wp, &
      -1.52160949662516078556178806805e-1_wp, 2.01365400804030348374776537501e-1_wp, 4.47106157277725905176885569043e-2_wp]
    tableau%a(14, [1, 7, 8, 9, 10, 11, 12, 13]) = [5.61675022830479523392909219681e-2_wp, 2.53500210216624811088794765333e-1_wp, &
      -2.46239037470802489917441475441e-1_wp, -1.24191423263816360469010140626e-1_wp, 1.5329179827876569731206322685e-1_wp, &
      8.20105229563468988491666602057e-3_wp, 7.56789766054569976138603589584e-3_wp, -8.298e-3_wp]
    tableau%a(15, [1, 6, 7, 8, 11, 12, 13, 14]) = [3.18346481635021405060768473261e-2_wp, 2.83009096723667755288322961402e-2_wp, &
      5.35419883074385676223797384372e-2_wp, -5.49237485713909884646569340306e-2_wp, -1.08347328697249322858509316994e-4_wp, &
      3.82571090835658412954920192323e-4_wp, -3.40465008687404560802977114492e-4_wp, 1.41312443674632500278074618366e-1_wp]
    tableau%a(16, [1, 6, 7, 8, 9, 13, 14, 15]) = [-4.28896301583791923408573538692e-1_wp, -4.69762141536116384314449447206_wp, &
      7.68342119606259904184240953878_wp, 4.06898981839711007970213554331_wp, 3.56727187455281109270669543021e-1_wp, &
      -1.39902416515901462129418009734e-3_wp, 2.9475147891527723389556272149_wp, -9.15095847217987001081870187138_wp]
    tableau%b = tableau%a(13, :)
    tableau%error([1, 6, 7, 8, 9, 10, 11, 12], 1) = [0.1312004499419488073250102996e-1_wp, -0.1225156446376204440720569753e+1_wp, &
      -0.4957589496572501915214079952_wp, 0.1664377182454986536961530415e+1_wp, -0.3503288487499736816886487290_wp, &
      0.3341791187130174790297318841_wp, 0.8192320648511571246570742613e-1_wp, -0.2235530786388629525884427845e-1_wp]
    tableau%error(:, 2) = tableau%b
    tableau%error(1, 2) = tableau%b(1) - 0.244094488188976377952755905512_wp
    tableau%error(9, 2) = tableau%b(9) - 0.733846688281611857341361741547_wp
    tableau%error(12, 2) = tableau%b(12) - 0.220588235294117647058823529412e-1_wp
    tableau%dense([1, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16], 1) = [-0.84289382761090128651353491142e+1_wp, &
      0.56671495351937776962531783590_wp, -0.30689499459498916912797304727e+1_wp, 0.23846676565120698287728149680e+1_wp, &
      0.21170345824450282767155149946e+1_wp, -0.87139158377797299206789907490_wp, 0.22404374302607882758541771650e+1_wp, &
      0.63157877876946881815570249290_wp, -0.88990336451333310820698117400e-1_wp, 0.18148505520854727256656404962e+2_wp, &
      -0.91946323924783554000451984436e+1_wp, -0.44360363875948939664310572000e+1_wp]
    tableau%dense([1, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16], 2) = [0.10427508642579134603413151009e+2_wp, &
      0.24228349177525818288430175319e+3_wp, 0.16520045171727028198505394887e+3_wp, -0.37454675472269020279518312152e+3_wp, &
      -0.22113666853125306036270938578e+2_wp, 0.77334326684722638389603898808e+1_wp, -0.30674084731089398182061213626e+2_wp, &
      -0.93321305264302278729567221706e+1_wp, 0.15697238121770843886131091075e+2_wp, -0.31139403219565177677282850411e+2_wp, &
      -0.93529243588444783865713862664e+1_wp, 0.35816841486394083752465898540e+2_wp]
    tableau%dense([1, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16], 3) = [0.19985053242002433820987653617e+2_wp, &
      -0.38703730874935176555105901742e+3_wp, -0.18917813819516756882830838328e+3_wp, 0.52780815920542364900561016686e+3_wp, &
      -0.11573902539959630126141871134e+2_wp, 0.68812326946963000169666922661e+1_wp, -0.10006050966910838403183860980e+1_wp, &
      0.77771377980534432092869265740_wp, -0.27782057523535084065932004339e+1_wp, -0.60196695231264120758267380846e+2_wp, &
      0.84320405506677161018159903784e+2_wp, 0.11992291136182789328035130030e+2_wp]
    tableau%dense([1, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16], 4) = [-0.25693933462703749003312586129e+2_wp, &
      -0.15418974869023643374053993627e+3_wp, -0.23152937917604549567536039109e+3_wp, 0.35763911791061412378285349910e+3_wp, &
      0.93405324183624310003907691704e+2_wp, -0.37458323136451633156875139351e+2_wp, 0.10409964950896230045147246184e+3_wp, &
      0.29840293426660503123344363579e+2_wp, -0.43533456590011143754432175058e+2_wp, 0.96324553959188282948394950600e+2_wp, &
      -0.39177261675615439165231486172e+2_wp, -0.14972683625798562581422125276e+3_wp]
    ! tau^4 (1 - tau)^3 is largest at 4/7.
    tableau%dense_error = (4.0_wp/7.0_wp)**4*(3.0_wp/7.0_wp)**3*tableau%dense(:, 4)
  end function dop853
end module dst_runge_kutta_tableaux
