"""The equation of every kind of cause, for its page. `v` is its value, a subscript rec what was recorded."""

from __future__ import annotations

# kind -> (LaTeX, what its further symbols are)
EQUATIONS: dict[str, tuple[str, str]] = {
    "aero_term": (r"C = C_\mathrm{file} + v\,\chi", r"$\chi$ is the term, such as $\alpha^2$ or $q^*$."),
    "unsteady_aero": (
        r"C = C_\mathrm{file} + v\,\dot\alpha\,\frac{l}{V}",
        r"$l$ is the rate length of the file; $\dot\beta$ for CY, Cl, Cn. With a time constant $T$ the rate is that of "
        r"the lagged angle, $T\dot\alpha_l = \alpha - \alpha_l$.",
    ),
    "configuration_change": (
        r"C_i = C_{i,\mathrm{file}} + v_i\,\mathrm{ramp}(t; t_0, d)",
        r"The ramp rises from 0 at the onset $t_0$ to 1 at $t_0 + d$.",
    ),
    "wind_shear": (
        r"w(t) = v\,\min(\max(t - t_0, 0),\, d)",
        r"Along a fixed direction over the ground, from the onset $t_0$ for the duration $d$.",
    ),
    "gust": (
        r"w(t) = \frac{v}{2}\Bigl(1 - \cos\frac{2\pi(t - t_0)}{L}\Bigr),\quad t_0 \le t \le t_0 + L",
        r"$L$ is its duration [s].",
    ),
    "turbulence": (
        r"\mathbf w(t) \sim \mathcal N(0, v^2),\ \text{coloured in time}",
        r"Process noise of the air's velocity; $v$ is its r.m.s.",
    ),
    "actuator_lag": (r"v\,\dot\delta = \delta_\mathrm{rec} - \delta", r"$\delta$ is what acts."),
    "input_delay": (r"\delta(t) = \delta_\mathrm{rec}(t - v)", r"Negative: what acts is ahead of its record."),
    "second_order_actuator": (
        r"v^2\,\ddot\delta + 2\zeta v\,\dot\delta + \delta = \delta_\mathrm{rec}",
        r"$1/v$ is its natural frequency, $\zeta$ the parameter `damping`.",
    ),
    "input_limit": (
        r"\delta = \min(\delta_\mathrm{rec},\, v)\quad\text{or}\quad \max(\delta_\mathrm{rec},\, v)",
        r"The term says which: `above` or `below`.",
    ),
    "input_offset": (r"\delta = \delta_\mathrm{rec} + v", r"$\delta$ is what acts."),
    "input_scale": (r"\delta = (1 + v)\,\delta_\mathrm{rec}", r"$\delta$ is what acts."),
    "sample_hold": (
        r"\delta(t) = \delta_\mathrm{rec}\bigl(v \lfloor t/v \rfloor\bigr)",
        r"$t$ counts from the first sample.",
    ),
    "missing_term": (
        r"\dot x = f + v\,\tau",
        r"$\tau$ is the term: a monomial or one of your own.",
    ),
    "parameter_change": (r"p = p_0 + v", r"$p_0$ is the value in the other records."),
    "damping": (r"\dot x = f - v\,x", r"$x$ is the state that is its target."),
    "cross_damping": (r"\dot x = f - v\,y", r"$y$ is the state that is its term."),
    "dry_friction": (
        r"\dot x = f - \bigl(v + s\,e^{-(x/b)^2}\bigr) \tanh(x/a)",
        r"$a$ is the parameter `creep`; $s$ is `at_rest` and $b$ `falls_over`, with $s = 0$ where they are not given.",
    ),
    "relaxation": (r"\dot x = f + v\,(l - x)", r"$l$ is the parameter `level`."),
    "inertia_scale": (r"\dot x = \frac{f}{1 + v}", r"$f$ is the whole equation of the state."),
    "parameter_split": (
        r"\dot x = f(p + v)",
        r"$x$ is the state that is its term; everywhere else the parameter is $p$.",
    ),
    "common_factor": (r"p_i = (1 + v)\,p_{i,0}", r"$p_i$ are the parameters that its target joins."),
    "sensor_stuck": (
        r"z(t) = y(t) + v\,[t \ge t_0]\,\bigl(\bar z - y(t)\bigr)",
        r"$\bar z$ is the mean reading from the onset $t_0$ on.",
    ),
    "rate_limit": (r"|\dot\delta| \le v", r"$\delta$ follows $\delta_\mathrm{rec}$ as fast as that allows."),
    "dead_zone": (
        r"\delta = c\,\delta_m + \mathrm{sign}(e)\,\max(|e| - v,\, 0),\quad e = \delta_\mathrm{rec} - c\,\delta_m",
        r"$\delta_m$ is the median of the record, $c$ the parameter `about`.",
    ),
    "backlash": (
        r"\delta_k = \min\bigl(\max(\delta_{k-1},\ \delta_{\mathrm{rec},k} - v),\ \delta_{\mathrm{rec},k} + v\bigr)",
        r"$2v$ is the free play.",
    ),
    "hysteresis": (
        r"\delta = \delta_\mathrm{rec} - v\,z,\quad d\,\dot z = \dot\delta_\mathrm{rec} - |\dot\delta_\mathrm{rec}|\,z",
        r"$d$ is the parameter `stroke`, and $z$ begins at the parameter `rest`. In the equation of a speed $x$, with "
        r"$d$ the parameter `travel`: $\dot x = f - v\,z$, $d\,\dot z = x - |x|\,z$, which is `dry_friction` for a "
        r"travel of 0; $d$ must be longer than half of what the speed runs in a sample.",
    ),
    "effectiveness_change": (
        r"\delta(t) = \delta_\mathrm{rec}(t)\,\bigl(1 + v\,[t \ge t_0]\bigr)",
        r"$t_0$ is the onset.",
    ),
    "stuck": (
        r"\delta = \delta_\mathrm{rec} + v\,(\delta_\mathrm{rec}(t_0) - \delta_\mathrm{rec})\,[t_0 \le t < t_1]",
        r"$t_0$ is the onset, $t_1$ the end.",
    ),
    "feedback": (
        r"\delta = \delta_\mathrm{rec} + v\,(y - y_w),\quad T\,\dot y_w = y - y_w",
        r"$y$ is what is fed back; $y_w = 0$ without the washout of time constant $T$.",
    ),
    "sensor_resolution": (
        r"z = v\,\mathrm{round}(y / v)",
        "$z$ is read where $y$ is true. A model has no parameter for it: the mean of $z$ does not depend on $v$, which "
        "shows as a variance of $v^2 / 12$ among the noise, to some percent; `casid check` tells $v$ to all digits, "
        "from how far samples are apart. `simulate` rounds.",
    ),
    "sensor_bias": (r"z = y + v", r"$z$ is read where $y$ is true."),
    "sensor_scale": (r"z = (1 + v)\,y", r"$z$ is read where $y$ is true."),
    "sensor_delay": (r"z(t) = y(t - v)", r"$z$ is read where $y$ is true."),
    "sensor_lag": (r"v\,\dot z = y - z", r"$z$ is read where $y$ is true."),
    "structural_mode": (
        r"z = y + v\,\frac{\omega_0^2\,s}{s^2 + 2\zeta\omega_0 s + \omega_0^2}\,\delta",
        r"$\omega_0 = 2\pi f$ with the frequency $f$, $\zeta$ the damping ratio, $\delta$ the surface that excites it.",
    ),
    "vane_position": (
        r"\alpha_z = \arctan\frac{w_v}{u_v},\quad \mathbf V_v = \mathbf V + "
        r"\boldsymbol\omega \times (\mathbf r + v\,\mathbf e_x)",
        r"$\mathbf r$ is where the file has the vane, from the centre of gravity; for $\beta$ likewise.",
    ),
    "accelerometer_position": (
        r"\mathbf a_z = \mathbf a + \dot{\boldsymbol\omega} \times \mathbf r + "
        r"\boldsymbol\omega \times (\boldsymbol\omega \times \mathbf r),\quad "
        r"\mathbf r = \mathbf r_\mathrm{file} + v\,\mathbf e",
        r"$\mathbf e$ is the body axis that is its target.",
    ),
    "cg_offset": (
        r"\mathbf M = \mathbf M_\mathrm{file} - v\,\mathbf e \times \mathbf F,\quad "
        r"\mathbf r_i = \mathbf r_{i,\mathrm{file}} - v\,\mathbf e",
        r"Forces $\mathbf F$ turn about another point, and every instrument $i$ has another arm.",
    ),
    "moment_reference": (
        r"\mathbf M = \mathbf M_\mathrm{file} + v\,\mathbf e \times \mathbf F_\mathrm{aero}",
        r"Aerodynamic forces act at the point that the moments of the file are about.",
    ),
    "mass": (r"m = m_\mathrm{file} + v", ""),
    "inertia": (r"I = I_\mathrm{file} + v", r"$I$ is the component that is its target."),
    "table_increment": (
        r"C = C_\mathrm{file} + v\,s(\chi)",
        r"$s$ is 1 in a stretch of a table's breakpoints, 0 beyond its ends, and runs between as the table does.",
    ),
    "thrust_asymmetry": (r"N = N_\mathrm{file} - v\,T", r"$T$ is the thrust, $N$ the yawing moment."),
    "thrust_line": (r"M = M_\mathrm{file} + v\,T", r"$T$ is the thrust, $M$ the pitching moment."),
    "sensor_misalignment": (
        r"\mathbf z = R(v)\,\mathbf y",
        r"$R$ turns rates, specific forces and angular accelerations about one body axis.",
    ),
    "position_error": (
        r"z = y + v\,(\chi - \chi_\mathrm{trim})",
        r"$\chi$ is what the reading depends on, such as $\alpha$.",
    ),
    "thrust_scale": (r"T = (1 + v)\,T_\mathrm{rec}", ""),
    "rotor_effectiveness": (r"T_i = (1 + v)\,T_{i,\mathrm{file}}(u_i)", "Of one rotor, or of all."),
    "thrust_curve": (
        r"T_i = T_{i,\mathrm{file}} + v\,(T_{i,\mathrm{file}} - T_{i,\mathrm h})\quad\text{or}\quad "
        r"T_i = T_{i,\mathrm{file}} + v\,(T_{i,\mathrm{file}} - T_{i,\mathrm h})^2 / T_\mathrm h",
        r"Slope or curvature. $T_{i,\mathrm h}$ is the part of the weight that the rotor carries in hover, "
        r"$T_\mathrm h$ the weight over the number of rotors, $T_{i,\mathrm{file}}$ includes the effectiveness.",
    ),
    "rotor_torque": (r"Q_i = (1 + v)\,\kappa_i\,T_i", r"$\kappa_i$ is the torque per thrust of the file."),
    "rotor_lag": (
        r"(T_\mathrm{file} + v)\,\dot u = u_\mathrm{rec} - u",
        r"$T_\mathrm{file}$ is the time constant of the file, $u$ the input that acts.",
    ),
    "rotor_rise_fall": (
        r"T_\mathrm{file}\,\dot u = u_\mathrm{rec} - u\ (u_\mathrm{rec} > u),\quad (T_\mathrm{file} + v)\,\dot u = "
        r"u_\mathrm{rec} - u\ (u_\mathrm{rec} \le u)",
        r"$T_\mathrm{file}$ is the time constant of the file, $u$ the input that acts.",
    ),
    "rotor_limit": (r"T_i = \min(T_{i,\mathrm{file}},\, v)", r"$T_i$ is its thrust at rest."),
    "rotor_tilt": (
        r"\mathbf n_i = R(v)\,\mathbf n_{i,\mathrm{file}}",
        r"$R$ turns the axis $\mathbf n_i$ of its thrust about the body axis that is its term.",
    ),
    "missing_derivative": (
        r"C = C_\mathrm{file} + v\,\chi",
        r"$\chi$ is the variable of the derivative, as for `aero_term`, which it equals.",
    ),
    "rotor_delay": (r"u(t) = u_\mathrm{rec}(t - \tau_\mathrm{file} - v)", r"$\tau_\mathrm{file}$ is that of the file."),
    "rotor_position": (r"\mathbf r_i = \mathbf r_{i,\mathrm{file}} + v\,\mathbf e", r"$\mathbf e$ is the body axis."),
    "rotor_swap": (r"u_i = u_{i,\mathrm{rec}} + v\,(u_{j,\mathrm{rec}} - u_{i,\mathrm{rec}})", "And the same for $j$."),
    "added_mass": (
        r"m = m_\mathrm{file} + v,\quad \mathbf r_\mathrm{cg} = \frac{v}{m}\,\mathbf r_i",
        r"$\mathbf r_i$ is the hub of the rotor; the inertia grows by that of a point there.",
    ),
    "mass_change": (
        r"\dot u = \dot u_\mathrm{file} + \Bigl(\frac{1}{1 + v} - 1\Bigr) \frac{T}{m_\mathrm{file}}",
        r"From the onset on; $T$ is the thrust of the rotors along the axis of $u$, and likewise along the others.",
    ),
    "body_drag": (
        r"X = X_\mathrm{file} - v\,\frac{1}{n} \sum_i \sqrt{T_i / T_\mathrm{hover}}\,u_i",
        r"Each rotor has its part at its hub, whose velocity against the air along the axis is $u_i$.",
    ),
    "rotor_inflow": (
        r"T_i = T_{i,\mathrm{file}} - v\,\sqrt{T_i\,T_\mathrm{hover}}\,V_a",
        r"$V_a$ is the velocity of the hub along its thrust.",
    ),
    "battery_sag": (r"T_i = T_{i,\mathrm{file}}\,(U / U_\mathrm{ref})^{v}", r"$U$ is the voltage of the battery."),
    "clock_drift": (
        r"z(t) = y\Bigl(t - \frac{v}{1 + v}(t - t_1)\Bigr)",
        r"$t_1$ is the first sample; what stands in the record at $t$ was read earlier when the clock runs fast.",
    ),
}
