//! The link to robots that speak Unitree's messages.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use super::dds::{Dds, Joining, Sending, lock};
use crate::RobotError;
use crate::command::Command;
use crate::robot::Robot;
use crate::state::Seal;
use crate::unitree::{CommandMessage, StateMessage};

impl Joining {
    pub(super) fn unitree<S: StateMessage, C: CommandMessage>(
        mut self,
        robot: &Robot,
        silent: bool,
    ) -> Result<Dds, RobotError> {
        let (slots, into) = (robot.slots(), self.inbox());
        // What the last state says of the machine; commands repeat it.
        let machine = Arc::new(AtomicU8::new(0));
        let kind = Arc::clone(&machine);
        self.hear((robot.state_topic(), S::TYPE), "states", move |state: S| {
            let reading = state.reading(&slots);
            // A damaged message must not change what commands say of the machine.
            if reading.seal != Seal::Wrong {
                kind.store(state.machine(), Ordering::Relaxed);
            }
            lock(&into).push(reading);
        })?;
        let writer = self.commands::<C>((robot.command_topic(), C::TYPE), silent)?;
        let sending = writer.map(|writer| -> Sending {
            Box::new(move |command: &Command| {
                writer.send(C::for_motors(command, &slots, machine.load(Ordering::Relaxed)))
            })
        });
        Ok(self.link(sending))
    }
}
