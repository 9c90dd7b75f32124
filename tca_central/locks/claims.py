"""Locks and reservations: a module has a resource to itself for a while.

A claim waits in the resource's queue like a message, until the resource is empty. resources.py
defines the order of the queue. A claim ends when its module releases it, and when its task or
message ends, fails, is killed or is retried. A claim also ends with its connection, and when it is
revoked for an operator or to end a deadlock. A claim is *kept* when the handler that made it has
returned and its task has not ended. A kept claim may cause a deadlock: its task may need another
claim, which waits for the kept one. (TCA 8.5: LockResource, ReserveResource.)
"""

from tca_central.errors import RequestError
from tca_central.model.budget import CLAIM_BYTES
from tca_central.model.clock import checked_seconds
from tca_central.model.deliveries import (
    Connection,
    Delivery,
    LostClaim,
    Module,
    ModuleClaim,
    ModuleResource,
)
from tca_central.model.resources import Claim
from tca_central.needs.texts import why_not_granted
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.messages.failures import TIMEOUT
from tca_wire.packets import headers
from tca_wire.packets.headers import Answer, Refused, ToModule
from tca_wire.vocabulary import Due, Outcome, Refusal

MOST_CLAIMS = 1000
"""Claims that may wait for one resource."""


def on_lock(central: State, connection: Connection, header: headers.Lock, _: bytes) -> None:
    """Queue a module's claim to lock or reserve a resource."""
    what = "a reservation" if header.reserve else "a lock"
    if header.timeout >= 0 or header.timeout != header.timeout:
        checked_seconds(header.timeout, f"{what} of '{header.resource}' with a timeout")
    resource = find_resource(central, header.resource, header.module)
    claim = Claim(resource, connection, connection.module, admits_owner=header.reserve)
    claim.holder = _checked_holder(central, connection, header.origin)
    _check(resource, claim)
    central.check_declared(CLAIM_BYTES)
    claim.id, claim.number, claim.priority = central.new_id(), header.number, header.priority
    central.claims[connection, header.number] = claim
    connection.outstanding[header.number] = claim
    if claim.holder is not None:
        central.claimed_for.setdefault(claim.holder, []).append(claim)
    sender, origin = connection.module.name, header.origin
    central.facts.append(
        facts.Claimed(claim.id, resource.module, resource.name, header.reserve, sender, origin)
    )
    if header.timeout >= 0:
        claim.timer = central.clock.after(header.timeout, Due.CLAIM, claim)
    central.dispatcher.claim(claim)
    if header.blocking:
        central.block(connection, header.number, header.origin, brief=header.brief)


def find_resource(central: State, name: str, module: str) -> ModuleResource:
    """Return the resource of that name and *module* ("": any module).

    Raise RequestError if no module has such a resource, or if several do.
    """
    modules = [one for one in central.registry.modules.values() if name in one.resources]
    # The copies of a program count as one: the newest copy, or the one with exactly that name.
    found = {one.called: one.resources[name] for one in modules if module in ("", one.called)}
    found |= {one.called: one.resources[name] for one in modules if module == one.name}
    if not found:
        whose = f"module '{module}'" if module else "no module"
        has = "is not connected, or has no" if module else "has a"
        raise RequestError(Refusal.UNKNOWN, f"{whose} {has} resource '{name}': see 'tca modules'")
    if len(found) > 1:
        owners = ", ".join(f"'{resource.module}'" for resource in found.values())
        raise RequestError(
            Refusal.UNKNOWN, f"modules {owners} have a resource '{name}': name the module, too"
        )
    return next(iter(found.values()))


def _checked_holder(central: State, connection: Connection, origin: int) -> Delivery | None:
    """Return delivery *origin*, with whose end a claim ends; None for origin 0.

    Raise RequestError if the connection does not handle that delivery.
    """
    if not origin:
        return None
    delivery = central.dispatcher.running.get(origin)
    if delivery is None or delivery.slot is not connection:
        module = connection.module.name
        what = f"delivery {{{origin}}}, for which module '{module}' wants a resource"
        raise RequestError(Refusal.TOO_LATE, f"{what}, is not handled there")
    return delivery


def _check(resource: ModuleResource, claim: ModuleClaim) -> None:
    """Raise RequestError if a claim would wait for its own holder, or if too many claims wait."""
    held_by = resource.held_by
    if (
        held_by is not None
        and held_by.holder is claim.holder
        and (claim.holder or held_by.slot is claim.slot)
    ):
        kind = "reserved" if held_by.admits_owner else "locked"
        raise RequestError(
            Refusal.PROTOCOL,
            f"resource '{resource.name}' is {kind} already by the same holder: release it",
        )
    if len(resource.claims) >= MOST_CLAIMS:
        raise RequestError(
            Refusal.OVERLOAD,
            f"{MOST_CLAIMS:,} claims wait to lock or reserve resource '{resource.name}'",
        )


def on_granted(central: State, claim: ModuleClaim) -> None:
    """Notify a module that its claim was granted."""
    central.clock.cancel(claim.timer)
    central.facts.append(facts.Granted(claim.id))
    if claim.slot.outstanding.pop(claim.number, None) is not None:
        central.answer(claim.slot, claim.number, Answer(claim.number))


# --- ends -----------------------------------------------------------------------------------------


def on_time_out(central: State, claim: ModuleClaim) -> None:
    """End a claim that has waited for its full timeout."""
    text = why_not_granted(central, claim)
    _fail(central, claim, text, Answer(claim.number, Outcome.FAILED, TIMEOUT, text))


def refuse_claim(central: State, claim: ModuleClaim, refusal: Refusal, text: str) -> None:
    """Refuse the request for a claim that can never be granted."""
    _fail(central, claim, text, Refused(claim.number, refusal, text))


def _fail(central: State, claim: ModuleClaim, why: str, answer: ToModule) -> None:
    """End a claim that was not granted, and answer its request."""
    _end(central, claim, why)
    if claim.slot.outstanding.pop(claim.number, None) is not None:
        central.answer(claim.slot, claim.number, answer)


def release_claim(central: State, connection: Connection, number: int, why: str) -> None:
    """End a claim that its module releases, or for which its module no longer waits."""
    if (claim := central.claims.get((connection, number))) is not None:
        _end(central, claim, "released" if claim.is_granted else why)


def end_claims_of(central: State, delivery: Delivery, why: str) -> None:
    """End the claims of a task or message that has ended, or whose handler has failed."""
    for claim in central.claimed_for.pop(delivery, ()):
        if claim.is_granted:
            _end(central, claim, f"{delivery.message.title}: {why}")
        else:
            refuse_claim(central, claim, Refusal.TOO_LATE, f"the message it was for: {why}")


def end_claims_of_killed(central: State, task: Delivery) -> None:
    """End a killed task's claims.

    While its handler runs, the task keeps its granted claims: termination messages may need them.
    """
    for claim in list(central.claimed_for.get(task, ())):
        if not claim.is_granted:
            refuse_claim(central, claim, Refusal.TOO_LATE, "the task it was for was killed")
        elif task.slot is None:
            _end(central, claim, f"{task.message.title} was killed")


def revoke(central: State, claim: ModuleClaim, why: str, text: str) -> None:
    """Revoke a claim, and notify its holder with *text*, unless its handler has returned."""
    _end(central, claim, why)
    if claim.holder is None or claim.holder.slot is not None:
        _remember_loss(claim.slot, claim, text)
        central.notify(claim.slot, headers.Taken(claim.number, text))


def _remember_loss(slot: Connection, claim: ModuleClaim, text: str) -> None:
    """Remember the loss of a claim until its module learns of it, maybe after a reconnection."""
    delivery = claim.holder.handling_id if claim.holder is not None else 0
    slot.lost_claims[claim.number] = LostClaim(delivery, claim.resource.name, text)
    if len(slot.lost_claims) > MOST_CLAIMS:
        del slot.lost_claims[next(iter(slot.lost_claims))]


def pop_losses(slot: Connection, delivery: Delivery) -> str:
    """Forget the claims that an ended handler lost unnoticed. Return them in words ("": none)."""
    if not slot.lost_claims:
        return ""
    numbers = [
        number for number, one in slot.lost_claims.items() if one.delivery == delivery.handling_id
    ]
    lost = map(slot.lost_claims.pop, numbers)
    return "; ".join(f"'{one.resource}' was taken from it: {one.text}" for one in lost)


def suspect_kept_claims(central: State, delivery: Delivery) -> None:
    """Have the claims that a returned handler has kept checked for a deadlock."""
    if central.claimed_for:
        central.suspects.extend(
            claim for claim in central.claimed_for.get(delivery, ()) if claim.is_granted
        )


def end_claims_of_connection(central: State, connection: Connection) -> None:
    """End the claims of a closed connection."""
    for claim in [one for one in central.claims.values() if one.slot is connection]:
        if claim.is_granted:
            _remember_loss(connection, claim, "the connection to central was lost")
        _end(central, claim, f"module '{connection.module.name}' left")


def end_claims_on_module(central: State, module: Module, why: str) -> None:
    """End the claims on the resources of a disconnected module.

    If another copy of the program has the resource, that copy inherits the claims.
    """
    for resource in module.resources.values():
        if (copy := resource.leave_copies()) is not None:
            central.dispatcher.to_refill.append((copy, None))
    for claim in [
        one
        for one in central.claims.values()
        if module.resources.get(one.resource.name) is one.resource
    ]:
        text = f"module '{module.name}' left: {why}"
        if claim.is_granted:
            revoke(central, claim, text, text)
        else:
            refuse_claim(central, claim, Refusal.UNKNOWN, text)


def _end(central: State, claim: ModuleClaim, why: str) -> None:
    """Remove a claim, granted or not, and let others have its resource."""
    central.dispatcher.end_claim(claim)
    central.clock.cancel(claim.timer)
    del central.claims[claim.slot, claim.number]
    holder = claim.holder
    if holder is not None and (claims := central.claimed_for.get(holder)) is not None:
        claims.remove(claim)
        if not claims:
            del central.claimed_for[holder]
    central.facts.append(facts.ClaimEnded(claim.id, why))
