"""What stands around an exported law: header, step, replay, build file and instructions."""

from __future__ import annotations

HEADER = """/* {title}

   Made by phcontrol {version}. C99, no dependencies but the mathematical library, no allocation. */
#ifndef PHCONTROL_LAW_H
#define PHCONTROL_LAW_H

#ifdef __cplusplus
extern "C" {{
#endif

typedef {real} law_real;

#define LAW_JOINTS {joints}
#define LAW_STATES {states} /* of the law itself */
#define LAW_MEASURED {measured} /* {measured_names} */
#define LAW_OPERATIONS {operations} /* of arithmetic, at most, in one step */

typedef enum {{
  LAW_OK = 0,
  LAW_STOPPED = 1,    /* a branch that is not compiled, or no finite torque: gravity compensated, motion damped;
                         0 where that is not finite either */
  LAW_BAD_INPUT = 2   /* an input, or the law's state, is not finite: no torque (0) */
}} law_status;

typedef struct {{
  double time;                  /* [s] */
  law_real state[{state_room}]; /* of the law, LAW_STATES of them */
}} law_state;

/* Start at time 0, with the law's state at its beginning. */
void law_init(law_state *self);

/* One step: fill `torque` [N m], and move time and the law's state on by `dt` [s].
   q, v: positions [rad] and velocities [rad/s], LAW_JOINTS each; measured: LAW_MEASURED numbers, may be NULL for 0.
   Unless LAW_OK is returned the law's state stays as it is. */
law_status law_step(law_state *self, const law_real *q, const law_real *v, const law_real *measured, law_real dt,
                    law_real *torque);

/* The law alone, without a memory: 1, or 0 where a branch is not compiled or the answer is not finite. Inputs must be
   finite: law_step looks. `rate` has LAW_STATES numbers, may be NULL
   for 0. */
int law_evaluate(law_real t, const law_real *q, const law_real *v, const law_real *state, const law_real *measured,
                 law_real *torque, law_real *rate);

/* What compensates gravity [N m]: of arms that add it themselves, subtract it from the torque. */
void law_gravity(const law_real *q, law_real *torque);

#ifdef __cplusplus
}}
#endif
#endif
"""

SOURCE = """/* {title} Made by phcontrol {version}. */
#include "law.h"
#include <math.h>
#include <stddef.h>

typedef law_real real;

/* Gains, goals, tables of references, in the order in which the law holds them. */
static const real numbers[{numbers_room}] = {{{numbers}}};
static const real beginning[{state_room}] = {{{beginning}}};

{functions}
static int all_finite(const real *values, int count) {{
  for (int i = 0; i < count; i++)
    if (!isfinite(values[i])) return 0;
  return 1;
}}

void law_init(law_state *self) {{
  self->time = 0.0;
  for (int i = 0; i < {state_room}; i++) self->state[i] = beginning[i];
}}

int law_evaluate(law_real t, const law_real *q, const law_real *v, const law_real *state, const law_real *measured,
                 law_real *torque, law_real *rate) {{
  real out[{outputs}];
  const real *p = numbers;
  if (!({calls}) || !all_finite(out, {outputs})) return 0;
  for (int i = 0; i < LAW_JOINTS; i++) torque[i] = out[i];
  for (int i = LAW_JOINTS; i < {outputs}; i++) rate[i - LAW_JOINTS] = out[i];
  return 1;
}}

void law_gravity(const law_real *q, law_real *torque) {{
  (void)gravity(0, q, NULL, NULL, NULL, numbers, torque);
}}

law_status law_step(law_state *self, const law_real *q, const law_real *v, const law_real *measured, law_real dt,
                    law_real *torque) {{
  real rate[{state_room}] = {{0}};
  if (!all_finite(q, LAW_JOINTS) || !all_finite(v, LAW_JOINTS) || !all_finite(&dt, 1) || !isfinite(self->time) ||
      !all_finite(measured, LAW_MEASURED) || !all_finite(self->state, LAW_STATES)) {{
    for (int i = 0; i < LAW_JOINTS; i++) torque[i] = 0;
    return LAW_BAD_INPUT;
  }}
  const double now = self->time;
  self->time = now + (double)dt;
  if (!law_evaluate((real)now, q, v, self->state, measured, torque, rate)) {{
    (void)stop(0, q, v, NULL, NULL, numbers, torque);
    if (!all_finite(torque, LAW_JOINTS))
      for (int i = 0; i < LAW_JOINTS; i++) torque[i] = 0;
    return LAW_STOPPED;
  }}
  for (int i = 0; i < {state_room}; i++) self->state[i] += dt * rate[i];
  return LAW_OK;
}}
"""

MAIN = """/* Replays recorded cases: what phcontrol ordered, against what this law orders.
   Made by phcontrol {version}. */
#include "law.h"
#include <math.h>
#include <stdio.h>

#define CASES {cases}
#define TOLERANCE {tolerance}

typedef struct {{
  law_real t, q[LAW_JOINTS], v[LAW_JOINTS], state[{state_room}], measured[{measured_room}];
  law_real torque[LAW_JOINTS], rate[{state_room}], gravity[LAW_JOINTS];
}} recorded_case;

static const recorded_case cases[CASES] = {{
{rows}
}};

static double size_of(const law_real *values, int count) {{
  double size = 0.0;
  for (int i = 0; i < count; i++) size = fmax(size, fabs((double)values[i]));
  return size;
}}

static double difference(const law_real *found, const law_real *expected, int count, double least) {{
  double worst = 0.0;
  for (int i = 0; i < count; i++) worst = fmax(worst, fabs((double)found[i] - (double)expected[i]));
  return worst / fmax(size_of(expected, count), least);
}}

int main(void) {{
  double worst = 0.0, torques = 0.0, rates = 1e-12;
  for (int k = 0; k < CASES; k++) {{
    torques = fmax(torques, size_of(cases[k].torque, LAW_JOINTS));
    rates = fmax(rates, size_of(cases[k].rate, LAW_STATES));
  }}
  for (int k = 0; k < CASES; k++) {{
    const recorded_case *c = &cases[k];
    law_real torque[LAW_JOINTS], rate[{state_room}] = {{0}}, gravity[LAW_JOINTS];
    if (!law_evaluate(c->t, c->q, c->v, c->state, c->measured, torque, rate)) {{
      printf("case %d: a branch is not compiled\\n", k);
      return 1;
    }}
    law_gravity(c->q, gravity);
    worst = fmax(worst, difference(torque, c->torque, LAW_JOINTS, 1e-3 * torques));
    worst = fmax(worst, difference(rate, c->rate, LAW_STATES, 1e-3 * rates));
    worst = fmax(worst, difference(gravity, c->gravity, LAW_JOINTS, 1e-3 * torques));
  }}
  /* a step is the law and its state moved on; what is not finite gives no torque */
  law_state self;
  law_real torque[LAW_JOINTS], rate[{state_room}] = {{0}}, broken[LAW_JOINTS];
  law_init(&self);
  const recorded_case *first = &cases[0];
  const int ordered = law_evaluate(0, first->q, first->v, self.state, first->measured, torque, rate);
  law_state moved = self;
  const law_status status = law_step(&moved, first->q, first->v, first->measured, (law_real)0.001, torque);
  if ((status == LAW_OK) != ordered) return 2;
  for (int i = 0; i < LAW_STATES && ordered; i++)
    if (fabs((double)(moved.state[i] - (self.state[i] + (law_real)0.001 * rate[i]))) > 0.0) return 2;
  for (int i = 0; i < LAW_JOINTS; i++) broken[i] = (law_real)NAN;
  if (law_step(&moved, broken, first->v, first->measured, (law_real)0.001, torque) != LAW_BAD_INPUT) return 3;
  for (int i = 0; i < LAW_JOINTS; i++)
    if (fabs((double)torque[i]) > 0.0) return 3;
  printf("%d cases, largest relative difference %.2e\\n", CASES, worst);
  return worst <= TOLERANCE ? 0 : 1;
}}
"""

CMAKE = """cmake_minimum_required(VERSION 3.10)
project(phcontrol_law C)
set(CMAKE_C_STANDARD 99)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
set(CMAKE_C_FLAGS_RELEASE "-O2") # no -ffast-math: the law computes what was certified

add_library(law STATIC law.c)
target_include_directories(law PUBLIC ${CMAKE_CURRENT_SOURCE_DIR})
set_target_properties(law PROPERTIES POSITION_INDEPENDENT_CODE ON)
target_link_libraries(law PUBLIC m)

enable_testing()
add_executable(replay main.c)
target_link_libraries(replay law)
add_test(NAME replay COMMAND replay)
"""

README = """# {law} of {robot}

{title} Made by phcontrol {version}: traced from the law's own file, and held against the interpreted law at
{cases} recorded states.

| | |
|---|---|
| joints | {joint_names} |
| the law's own state | {states} numbers ({real}) |
| measured beside q and q̇ | {measured_names} |
| operations in one step, at most | {operations} |
| ways through its branches that are compiled | {ways} |

Build, and replay the recorded cases:

```sh
cmake -B build && cmake --build build && ctest --test-dir build
```

## In a loop

`law_init` once, `law_step` in every period. No allocation, no locks, no system calls; one `law_state` a loop.

- `LAW_OK`: `torque` is the law's, the law's state has moved on by `dt` (explicit Euler, as phcontrol's own loop).
- `LAW_STOPPED`: the state asks for a branch that was not compiled, or the torque would not be finite. There is no
  interpreter to fall back on: `torque` compensates gravity and damps motion (0 where that is not finite), the law's
  state is held. Stop, and ask why.
- `LAW_BAD_INPUT`: an input, also one that is measured, or the law's state is not finite; the torque is 0.

Limits of torque and its rate are the loop's to keep: they are not in here.

### libfranka

The robot compensates gravity itself, so what is sent is the torque less gravity.

```cpp
#include "law.h"
law_state law;
law_init(&law);
robot.control([&](const franka::RobotState& state, franka::Duration period) -> franka::Torques {{
  law_real torque[LAW_JOINTS], gravity[LAW_JOINTS];
  const law_status status =
      law_step(&law, state.q.data(), state.dq.data(), {libfranka_measured}, period.toSec(), torque);
  law_gravity(state.q.data(), gravity);
  std::array<double, 7> command;
  for (size_t i = 0; i < 7; i++) command[i] = torque[i] - gravity[i];
  franka::Torques answer(command);
  return status == LAW_OK ? answer : franka::MotionFinished(answer);
}});
```

`state.tau_ext_hat_filtered` is the force of the environment on the joints, as `external_force` is. The arrays there are
doubles: an export in floats needs copies. An arm of another number of joints than {joints} is another arm.

### ros2_control

```cpp
controller_interface::return_type LawController::update(const rclcpp::Time&, const rclcpp::Duration& period) {{
  law_real q[LAW_JOINTS], v[LAW_JOINTS], torque[LAW_JOINTS];
  for (size_t i = 0; i < LAW_JOINTS; i++) {{
    q[i] = state_interfaces_[2 * i].get_value();      // position, in the order above
    v[i] = state_interfaces_[2 * i + 1].get_value();  // velocity
  }}
  const law_status status = law_step(&law_, q, v, {ros_measured}, period.seconds(), torque);
  for (size_t i = 0; i < LAW_JOINTS; i++) command_interfaces_[i].set_value(torque[i]);
  return status == LAW_OK ? controller_interface::return_type::OK : controller_interface::return_type::ERROR;
}}
```
"""
