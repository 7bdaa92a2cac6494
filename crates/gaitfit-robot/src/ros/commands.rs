//! Commands as ROS 2's messages.

use super::messages::{
    Dimension, DynamicJointState, Float64MultiArray, Header, InterfaceValue, Layout, Stamp,
};
use crate::command::{Command, MotorCommand};
use crate::robot::CommandPart;

/// The number of a command that an interface takes.
fn value(command: &MotorCommand, part: CommandPart) -> f64 {
    f64::from(match part {
        CommandPart::Position => command.q,
        CommandPart::Velocity => command.dq,
        CommandPart::Effort => command.tau,
        CommandPart::Stiffness => command.kp,
        CommandPart::Damping => command.kd,
    })
}

/// A command for the joints of these names, motor order.
pub fn dynamic(command: &Command, names: &[String], stamp: Stamp) -> DynamicJointState {
    let interface_names: Vec<String> = CommandPart::ALL.map(|one| one.name().to_owned()).into();
    let values = |motor: &MotorCommand| InterfaceValue {
        interface_names: interface_names.clone(),
        values: CommandPart::ALL.map(|interface| value(motor, interface)).into(),
    };
    DynamicJointState {
        header: Header { stamp, ..Header::default() },
        joint_names: names.to_vec(),
        interface_values: command.iter().map(values).collect(),
    }
}

/// A command without names: motor after motor, of each the numbers of `order`.
pub fn array(command: &Command, order: &[CommandPart]) -> Float64MultiArray {
    let each = |motor| order.iter().map(move |&interface| value(motor, interface));
    let data: Vec<f64> = command.iter().flat_map(each).collect();
    let size = data.len() as u32;
    let dimension = Dimension { label: "joints × interfaces".to_owned(), size, stride: size };
    Float64MultiArray { layout: Layout { dim: vec![dimension], data_offset: 0 }, data }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_in_the_order_that_the_file_states_joint_after_joint() {
        let command = Command::from([1.0, 2.0].map(|k| MotorCommand {
            q: 0.1 * k,
            dq: 0.2 * k,
            tau: 0.25 * k,
            kp: 10.0 * k,
            kd: k,
        }));
        let names = ["hip", "knee"].map(str::to_owned);
        let message = dynamic(&command, &names, Stamp { sec: 5, nanosec: 6 });
        assert_eq!((message.header.stamp.sec, message.joint_names), (5, names.to_vec()));
        let one = &message.interface_values[1];
        assert_eq!(one.interface_names, ["position", "velocity", "effort", "stiffness", "damping"]);
        assert_eq!(one.values, [0.2, 0.4, 0.5, 20.0, 2.0].map(|x: f32| f64::from(x)));
        use CommandPart::{Damping, Effort, Position, Stiffness};
        let message = array(&command, &[Damping, Effort, Position, Stiffness]);
        let wanted = [1.0, 0.25, 0.1, 10.0, 2.0, 0.5, 0.2, 20.0].map(|x: f32| f64::from(x));
        assert_eq!(message.data, wanted);
        let dimension = &message.layout.dim[0];
        assert_eq!((dimension.size, dimension.stride, message.layout.data_offset), (8, 8, 0));
    }
}
