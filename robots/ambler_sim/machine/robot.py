"""The real-time controller: executes moves on any plant, with a level body and even loads."""

import math
from collections import deque
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from robots.ambler_sim.geometry import (
    AMBLER,
    Array,
    feet_of,
    joints_of,
    stance_of,
    to_body,
    to_world,
)
from robots.ambler_sim.machine import motion, scanner
from robots.ambler_sim.machine.faults import FaultyPlant
from robots.ambler_sim.machine.motion import ROTATING, blend, ease, leg_segments
from robots.ambler_sim.machine.odometry import Odometry, compass
from robots.ambler_sim.machine.pacing import MoveWatch, OnTick, Pacer
from robots.ambler_sim.machine.plant import Plant, make_posture
from robots.ambler_sim.machine.terrain import Terrain
from robots.ambler_sim.messages import (
    AMPLIFIER_TRIPPED,
    JOINT_FAULT,
    NEEDS_OPERATOR,
    TERRAIN_COLLISION,
    TIP_OVER_RISK,
    MotionError,
)
from robots.ambler_sim.pictures.drawing import draw
from robots.ambler_sim.planning.gait import require_reach
from robots.ambler_sim.planning.stability import least_norm_loads, support_margin
from robots.ambler_sim.vocabulary import (
    LEGS,
    NO_LEG,
    BodyMove,
    Contact,
    Fault,
    Footfall,
    Footstep,
    LegMove,
    Pose,
    Readings,
    Snapshot,
    Stance,
)
from robots.rendering import SIZE

SETTLE_SECONDS = 0.5
STOP_SECONDS = 0.3
# Per second. With 5 the force sensors, the motors and the springs of the feet swing each other up.
BALANCE_RATE = 2.0
LEVEL_RATE = 3.0
GREATEST_CORRECTION = 0.4
LEAST_WAY = 1e-4
"""The shortest way (m) that has a direction."""

TRAIL = 60
"""The number of footholds remembered for pictures."""

MOST_LAG = 0.12
"""How far (m or rad) a joint of a swinging leg may lag."""

MOST_LAG_STANDING = 0.06
"""How far (m or rad) a joint of a standing leg may lag."""

MOST_TILT = 0.03
"""The inclination (rad) at which a move is stopped, with its leg put down: 1.7 degrees.

A robot that stands safely on five springy feet may tilt by 1.3 degrees.
"""

MOST_LOWERINGS = 3
"""The greatest number of times that a leg is lowered at the end of its move."""

LEVEL_ENOUGH = 0.005
LEVEL_SECONDS = 6.0
"""How long ``level`` may take to bring the inclination below LEVEL_ENOUGH (rad)."""

TOLERANCE = 0.05
"""How far (m) links may go beyond the planners' limits: feet creep centimetres on steep ground."""


class Robot:
    """A robot on some plant, for one thread. Moves block until done; only they let time pass."""

    def __init__(
        self, plant: Plant, terrain: Terrain, *, pace: float = 0.0, state: Snapshot | None = None
    ) -> None:
        self.terrain = terrain
        self.backend = plant.name
        self._plant = plant
        faults = (state.faults, state.armed) if state else ()
        self._machine = FaultyPlant(plant, *faults)
        self.pacer = Pacer(pace)
        self.time = state.time if state else 0.0
        """Simulated seconds since the walk began, in all processes that took part in it."""
        self.footsteps = state.footsteps if state else 0
        self._last_leg = state.last_leg if state else NO_LEG
        self._scans = state.scans if state else 0
        self._trail = deque(state.trail if state else (), maxlen=TRAIL)
        self._airborne: set[int] = set()
        self._command = plant.joints()
        pose = plant.attitude().pose
        self._place = np.array([pose.x, pose.y, pose.height])
        self._velocity, self._tilt = np.zeros(3), 0.0
        self._odometry = Odometry(state.pose if state else pose, self._command)
        self.peak_tilt = 0.0
        """The greatest tilt (rad) of the body since the last footstep or since the start."""
        self._settle()
        self.peak_tilt = 0.0
        if state is None:
            self._trail.extend(self.true_stance().feet)

    def stance(self) -> Stance:
        """Return the body pose and the six feet as the robot believes them to be, by dead
        reckoning.
        """
        return self._stance_at(self._pose())

    def true_stance(self) -> Stance:
        """Return the true stance, for pictures and for judging the walk."""
        return self._stance_at(self._plant.attitude().pose)

    def _pose(self) -> Pose:
        return self._odometry.estimate(self._machine.joints(), self._airborne)

    def _stance_at(self, pose: Pose) -> Stance:
        return stance_of(pose, self._machine.joints(), self._last_leg)

    def readings(self) -> Readings:
        """Return the readings of inclinometers, force sensors, amplifiers and encoders."""
        attitude = self._plant.attitude()
        loads = tuple(float(load) for load in self._machine.loads())
        return Readings(
            self.time,
            attitude.roll,
            attitude.pitch,
            loads,
            self._machine.amplifiers(),
            self._machine.encoder_offsets(),
        )

    # --- faults and repairs -----------------------------------------------------------------------

    def inject(self, fault: Fault) -> None:
        """Add a fault, which begins as soon as it can."""
        self._machine.arm(fault)

    def pop_begun_faults(self) -> list[Fault]:
        """Return the faults that have begun since the last call."""
        return self._machine.pop_begun_faults()

    def reset(self, leg: int, *, operator: bool = False) -> None:
        """Switch the amplifier of a leg on again. Raises NEEDS_OPERATOR if only an operator can."""
        if not self._machine.clear(leg, "amplifier trip", operator=operator):
            raise NEEDS_OPERATOR(
                leg, f"the amplifier of leg {leg} trips again: an operator must reset it"
            )

    def free_joint(self, leg: int, *, operator: bool = False) -> None:
        """Move a leg's joints until they are free. Raises NEEDS_OPERATOR if they stay stuck."""
        is_free = self._machine.clear(leg, "stuck joint", "motion fault", operator=operator)
        self._rebase()
        if is_free and leg in self._airborne:
            self._lower(leg, MoveWatch())
            self._rebase()
        self._settle()
        if not is_free:
            raise NEEDS_OPERATOR(leg, f"a joint of leg {leg} stays stuck: an operator must free it")

    def calibrate(self, leg: int) -> None:
        """Set a leg's relative encoder from the absolute encoder, and the leg's force sensor to
        zero.
        """
        self._machine.clear(leg, "encoder drift", "force sensor")
        self._rebase()

    def level(self) -> None:
        """Put down hanging legs and stand until the body is level or LEVEL_SECONDS are over."""
        self._rebase()
        began = self.time
        while self.time - began < LEVEL_SECONDS:
            for leg in filter(self._hangs, LEGS):
                self._lower(leg, MoveWatch())
            self._settle()
            if self._tilt <= LEVEL_ENOUGH and not any(map(self._hangs, LEGS)):
                break
        self._rebase()

    # --- moves ------------------------------------------------------------------------------------

    def move_leg(self, move: LegMove, on_tick: OnTick | None = None) -> Footfall:
        """Carry out a leg move. When stopped, the foot is put down where it is.

        Raises:
            AMPLIFIER_TRIPPED: before anything moved.
            TERRAIN_COLLISION: the leg met something on its way; the leg stands again.
            TIP_OVER_RISK: the body tilted; the leg stands again.
            JOINT_FAULT: the leg is where it got stuck, in the air, until ``free_joint``.
        """
        self._require_amplifiers()
        self._rebase()
        segments = leg_segments(move, self._pose(), self._command[move.leg])
        self._machine.before_swing(move.leg, segments[ROTATING], self.terrain)
        watch = MoveWatch(on_tick)
        self._airborne.add(move.leg)
        contact = self._swing_over(move.leg, segments, watch)
        self._put_down(move.leg, watch)
        self._begin_faults()
        footfall = self._record_landing(move.leg, reached=not watch.stopped and contact is None)
        _require_undisturbed(contact, watch)
        return footfall

    def move_body(self, move: BodyMove, on_tick: OnTick | None = None) -> Pose:
        """Carry the body to a pose over standing feet. Returns the pose reached. A stopped body
        comes to rest gently.

        Raises:
            AMPLIFIER_TRIPPED: before anything moved.
            OutOfReach: a leg could not follow; nothing moved.
            TERRAIN_COLLISION: the body met something; the body is back where it was.
            TIP_OVER_RISK: the body tilted.
            JOINT_FAULT: a joint of a standing leg does not follow.
        """
        self._require_amplifiers()
        self._rebase()
        start = self._pose()
        feet = to_world(start, feet_of(self._command))
        require_reach(joints_of(to_body(move.goal, feet)), TOLERANCE)
        watch = MoveWatch(on_tick)
        share, speed, step = 0.0, 1.0, self._plant.tick / move.duration
        contact = None
        while share < 1.0 and speed > 0.0:
            share += speed * step
            feet[:, 2] -= self._corrections()
            self._follow(blend(start, move.goal, ease(share)), feet, watch)
            if contact := self._bump(start, move.goal):
                break
            self._require_following(*LEGS, most=MOST_LAG_STANDING)
            if watch.stopped:
                speed -= self._plant.tick / STOP_SECONDS
        while contact is not None and share > 0.0:
            share -= step
            self._follow(blend(start, move.goal, ease(max(share, 0.0))), feet, watch)
        self._settle()
        self._begin_faults()
        self.footsteps += 1
        heading = compass(
            self._plant.attitude().pose.heading, self.terrain.spec.seed, self.footsteps
        )
        self._odometry.fix(self._machine.joints(), self._airborne, heading)
        _require_undisturbed(contact, watch)
        return self._pose()

    def scan(self) -> Array:
        """Points (n, 3) of one sweep of the range scanner, in the robot's believed world frame.

        No time passes. During a body move the points are blurred as if the sweep took time.
        """
        self._scans += 1
        attitude, seed = self._plant.attitude(), (self.terrain.spec.seed, self._scans)
        points = scanner.scan(self._machine.cast, attitude, seed, self._velocity)
        return to_world(self._pose(), to_body(attitude.pose, points))

    def footstep(self) -> Footstep:
        """Return the record of the last footstep, with the robot's belief and the truth."""
        believed, true = self.stance(), self.true_stance()
        leg, tilt = max(self._last_leg, 0), self.peak_tilt
        self.peak_tilt = 0.0
        return Footstep(
            self.footsteps,
            leg,
            believed.feet[leg],
            true.feet[leg],
            believed.pose,
            true.pose,
            self.terrain.gradient_at(true.pose.x, true.pose.y),
            tilt,
            support_margin(true),
        )

    def picture(self, path: str | Path, size: tuple[int, int] = SIZE) -> Path:
        """Write a photograph or, without a camera, a drawing. Returns the path written."""
        written = Path(path).with_suffix(".png")
        if not self._plant.photograph(written, tuple(self._trail), size):
            written = written.with_suffix(".svg")
            written.write_text(self.drawing(), encoding="utf-8")
        return written

    def drawing(self) -> str:
        """Draw the robot's true stance as SVG, with any backend."""
        return draw(self.true_stance(), self.terrain, self._trail)

    def state(self) -> Snapshot:
        """Return the state from which another process can continue."""
        return Snapshot(
            backend=self.backend,
            terrain=self.terrain.present,
            time=self.time,
            posture=make_posture(self._plant.attitude(), self._machine.joints()),
            pose=self._pose(),
            last_leg=self._last_leg,
            scans=self._scans,
            footsteps=self.footsteps,
            trail=tuple(self._trail),
            faults=tuple(self._machine.faults),
            armed=tuple(self._machine.armed),
        )

    def close(self) -> None:
        """Free the simulator; the robot cannot be used afterwards."""
        self._plant.close()

    def _rebase(self) -> None:
        """Command the measured joint values, so that old errors do not become forces. Restart the
        pacer.
        """
        self._command = self._machine.joints()
        self._odometry.fix(self._command, self._airborne)
        self.pacer.restart()

    def _swing_over(
        self, leg: int, segments: list[motion.Segment], watch: MoveWatch
    ) -> Contact | None:
        """Bring a leg over its foothold. After a contact, back off a little and return the
        contact.
        """
        lift, *others = segments
        self._swing(leg, lift, watch)
        for segment in others:
            share = self._swing(leg, segment, watch, stops_at_contact=True)
            if share < 1.0 and not watch.stopped:
                contact = self._contact(leg, segment, share)
                self._swing(leg, motion.back_off(segment, share), watch)
                return contact
        return None

    def _swing(
        self, leg: int, segment: motion.Segment, watch: MoveWatch, *, stops_at_contact: bool = False
    ) -> float:
        """Move a leg along a segment. Returns the share done before *watch* stopped the leg or,
        with *stops_at_contact*, before the leg met something.

        The other legs hold still. Levelling on five feet would tip the robot over in the physics
        backend.
        """
        ticks = math.ceil(segment.duration / self._plant.tick)
        for number in range(1, ticks + 1):
            if watch.stopped:
                return (number - 1) / ticks
            joints = self._command.copy()
            joints[leg] = segment.at(number / ticks)
            self._drive(joints, watch)
            if stops_at_contact and self._feels_contact(leg) and number < ticks:
                return number / ticks
            self._require_following(leg, most=MOST_LAG)
        return 1.0

    def _begin_faults(self) -> None:
        """After a move, begin the faults that waited for its end."""
        if self._machine.after_move():
            self._settle()

    def _require_amplifiers(self) -> None:
        """Raise AMPLIFIER_TRIPPED, before anything moves, if the amplifier of a leg is off."""
        for leg, is_on in enumerate(self._machine.amplifiers()):
            if not is_on:
                raise AMPLIFIER_TRIPPED(leg, f"the amplifier of leg {leg} is off")

    def _require_following(self, *legs: int, most: float) -> None:
        """Raise JOINT_FAULT, with the robot at rest, if one of *legs* lags by more than *most*."""
        lags = np.abs(self._command - self._machine.joints()).max(axis=1)
        leg = max(legs, key=lambda each: lags[each])
        if lags[leg] > most:
            self._rebase()
            self._settle()
            lag = float(lags[leg])
            raise JOINT_FAULT(
                MotionError(leg, lag), f"leg {leg} does not follow: it is {lag:.2f} m or rad behind"
            )

    def _feels_contact(self, leg: int) -> bool:
        felt = max(self._plant.pushes()[leg], self._plant.bumps()[leg])
        return bool(felt > motion.CONTACT_FORCE or self._machine.loads()[leg] > motion.TOUCH_LOAD)

    def _contact(self, leg: int, segment: motion.Segment, share: float) -> Contact:
        pose = self._pose()
        foot = self._stance_at(pose).feet[leg]
        force = math.hypot(
            self._plant.pushes()[leg], self._plant.bumps()[leg], self._machine.loads()[leg]
        )
        before, after = to_world(
            pose, feet_of(np.array([segment.at(share - 0.02), segment.at(share)]), [leg, leg])
        )
        return Contact(leg, foot.x, foot.y, foot.z, force, *_direction(before[:2], after[:2]))

    def _bump(self, start: Pose, goal: Pose) -> Contact | None:
        """Return the contact of the body or of a leg's beams on the way to *goal*; None without
        one.
        """
        bumps = self._plant.bumps()
        if bumps.max() <= motion.CONTACT_FORCE:
            return None
        pose, (dx, dy) = self._pose(), _direction((start.x, start.y), (goal.x, goal.y))
        nose, low = AMBLER.body_length / 2, pose.height - AMBLER.belly
        return Contact(
            NO_LEG, pose.x + nose * dx, pose.y + nose * dy, low, float(bumps.max()), dx, dy
        )

    def _put_down(self, leg: int, watch: MoveWatch) -> None:
        """Lower a leg until it stands, and settle. Repeat if it then bears no load."""
        for _ in range(MOST_LOWERINGS):
            self._lower(leg, watch)
            self._rebase()
            self._settle()
            if not self._hangs(leg):
                return

    def _hangs(self, leg: int) -> bool:
        """Return whether a foot bears no load; False if its sensor is broken."""
        return bool(self._machine.loads()[leg] < motion.HANGING_LOAD)

    def _lower(self, leg: int, watch: MoveWatch) -> None:
        """Lower a leg slowly until its force sensor feels the ground (a guarded move).

        The leg goes down as far as necessary, because a hanging leg must not count as standing.
        """
        self._odometry.fix(self._machine.joints(), self._airborne)
        self._airborne.add(leg)
        deepest = AMBLER.max_drop
        while self._machine.loads()[leg] < motion.TOUCH_LOAD and self._command[leg, 2] < deepest:
            joints = self._command.copy()
            speed = motion.HURRIED_SPEED if watch.tilt else motion.GUARDED_SPEED
            joints[leg, 2] += self._plant.tick * speed
            self._drive(joints, watch)
        if self._command[leg, 2] < deepest:
            self._odometry.fix(self._machine.joints(), self._airborne)
            self._airborne.discard(leg)

    def _follow(self, pose: Pose, feet: Array, watch: MoveWatch | None) -> None:
        self._drive(joints_of(to_body(pose, feet), near=self._command[:, 0]), watch)

    def _drive(self, joints: Array, watch: MoveWatch | None = None) -> None:
        """Run one tick of everything."""
        tick = self._plant.tick
        self._machine.drive(joints, (joints - self._command) / tick)
        self._command = joints
        self.time += tick
        attitude = self._plant.attitude()
        place = np.array([attitude.pose.x, attitude.pose.y, attitude.pose.height])
        self._velocity, self._place = (place - self._place) / tick, place
        self._tilt = math.hypot(attitude.roll, attitude.pitch)
        self.peak_tilt = max(self.peak_tilt, self._tilt)
        self.pacer.wait(tick)
        if watch is not None:
            watch.tick()
            if self._tilt > MOST_TILT:
                watch.stop_for_tilt(self._tilt)

    def _settle(self) -> None:
        """Stand still while loads and level even out."""
        for _ in range(math.ceil(SETTLE_SECONDS / self._plant.tick)):
            joints = self._command.copy()
            joints[:, 2] += self._corrections()
            self._drive(joints)

    def _corrections(self) -> Array:
        """Return how much each standing leg should extend in this tick to even out the loads and to
        level the body.

        Six stiff legs on the ground wobble like a table. Without this correction the robot would
        stand on two or three.
        """
        tick, attitude = self._plant.tick, self._plant.attitude()
        loads = self._machine.loads()
        standing = [leg for leg in LEGS if leg not in self._airborne and math.isfinite(loads[leg])]
        feet, loads = feet_of(self._command)[standing], loads[standing]
        lacking = least_norm_loads(feet, loads) - loads
        change = BALANCE_RATE * tick * lacking / AMBLER.foot_stiffness
        change += LEVEL_RATE * tick * (attitude.pitch * feet[:, 0] - attitude.roll * feet[:, 1])
        corrections = np.zeros(len(LEGS))
        corrections[standing] = change.clip(-GREATEST_CORRECTION * tick, GREATEST_CORRECTION * tick)
        return corrections

    def _record_landing(self, leg: int, *, reached: bool) -> Footfall:
        """Record where the foot has landed. After a stopped move the same leg steps next."""
        foot = self.stance().feet[leg]
        self._trail.append(self.true_stance().feet[leg])
        if reached:
            self._last_leg = leg
        return Footfall(foot, float(self._machine.loads()[leg]), reached)


def _require_undisturbed(contact: Contact | None, watch: MoveWatch) -> None:
    """Raise TERRAIN_COLLISION after a contact, TIP_OVER_RISK after a stop because of the tilt."""
    if contact is not None:
        what = f"leg {contact.leg}" if contact.leg in LEGS else "the body"
        where = f"x {contact.x:.2f}, y {contact.y:.2f}, z {contact.z:.2f}"
        raise TERRAIN_COLLISION(
            contact, f"{what} met something at {where} with {contact.force / 1000:.1f} kN"
        )
    if watch.tilt:
        raise TIP_OVER_RISK(watch.tilt, f"the body tilts by {math.degrees(watch.tilt):.1f} degrees")


def _direction(start: Sequence[float], end: Sequence[float]) -> tuple[float, float]:
    """Return the unit vector from one place to another; zero if they are the same."""
    way = math.dist(start, end)
    if way <= LEAST_WAY:
        return 0.0, 0.0
    return float(end[0] - start[0]) / way, float(end[1] - start[1]) / way
