//! Two reactors that answer each other: a feedback loop, which a logical action closes. Their reactions are methods.
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::time::Duration;

use hprm::prelude::*;

/// Serves a ball, and again when it comes back.
struct Ping {
    left: u32,
}

#[derive(Clone, Copy)]
struct PingPorts {
    serve: LogicalAction<()>,
    ping: OutputPort<u32>,
    pong: InputPort<u32>,
}

impl Reactor for Ping {
    type Ports = PingPorts;

    fn assemble(&mut self, ping: &mut ReactorBuilder<'_, Self>) -> PingPorts {
        let ports = PingPorts {
            serve: ping.logical_action("serve", Duration::from_millis(1)),
            ping: ping.output("ping"),
            pong: ping.input("pong"),
        };
        ping.reaction().on(Startup).schedules(ports.serve).run(move |_, ctx| {
            ctx.schedule(ports.serve, Duration::ZERO, ());
        });
        ping.reaction()
            .on(ports.serve)
            .sets(ports.ping)
            .run(move |ping, ctx| ping.serve(ports, ctx));
        ping.reaction()
            .on(ports.pong)
            .schedules(ports.serve)
            .run(move |ping, ctx| ping.answer(ports, ctx));
        ports
    }
}

impl Ping {
    fn serve(&mut self, ports: PingPorts, ctx: &mut Context<'_>) {
        self.left -= 1;
        ctx.set(ports.ping, self.left);
    }

    fn answer(&mut self, ports: PingPorts, ctx: &mut Context<'_>) {
        println!("{} ms: {} left", ctx.elapsed().as_millis(), self.left);
        if self.left > 0 {
            ctx.schedule(ports.serve, Duration::ZERO, ());
        }
    }
}

/// Sends everything back.
struct Pong;

impl Reactor for Pong {
    type Ports = (InputPort<u32>, OutputPort<u32>);

    fn assemble(&mut self, pong: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let (inp, out) = (pong.input("inp"), pong.output("out"));
        pong.reaction().on(inp).sets(out).run(move |_, ctx| {
            if let Some(ball) = ctx.get(inp).copied() {
                ctx.set(out, ball);
            }
        });
        (inp, out)
    }
}

fn main() -> Result<(), Failure> {
    let mut program = Program::new("PingPong").fast();
    let ping = program.add("ping", Ping { left: 3 });
    let (inp, out) = program.add("pong", Pong);
    program.connect(ping.ping, inp);
    program.connect(out, ping.pong);
    program.run()
}
