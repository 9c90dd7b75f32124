"""The tasks by which robots wait for each other: SetStatusSync and WaitForStatusSync."""

from robots.turtle_sim.errors import NoSuchPartner
from robots.turtle_sim.sync.environment import SyncEnvironment
from tca_behaviours.missions import OnceTask, PeriodicTask, Status, parameter


class SetStatusSync(OnceTask[SyncEnvironment]):
    """Change the status that the partners see."""

    status: int = parameter(description="The new status; the missions agree on its meaning")

    def iterate(self) -> None:
        """Send the status to the partners. The link repeats the status until each partner has
        acknowledged it.
        """
        self.env.link.set_status(self.status)


class WaitForStatusSync(PeriodicTask[SyncEnvironment]):
    """Wait until a partner has a status. The partner must hold it until this task ends."""

    partner: str = parameter(description="Name of the partner")
    status: int = parameter(description="The status to wait for")

    def initialise(self) -> None:
        """Fail at once if there is no such partner."""
        try:
            self.env.link.status(self.partner)
        except NoSuchPartner as error:
            raise self.failed(str(error)) from None

    def iterate(self) -> Status:
        """Check the partner's known status."""
        if self.env.link.status(self.partner) == self.status:
            return Status.COMPLETED
        self.report(f"waits for status {self.status}: {self.env.link.words(self.partner)}")
        return Status.RUNNING


TASKS_OF_TEAMS = (SetStatusSync, WaitForStatusSync)
"""The additional tasks of a turtle in a team."""
