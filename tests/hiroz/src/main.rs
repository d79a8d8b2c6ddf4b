//! Nodes of ROS 2 by another implementation, for `make conformance-ros2`: one for each role, until it has done its part.
//!
//! It prints what it receives, and nothing else. `run.py` starts it beside scripts and compares.

use std::time::{Duration, Instant};

use hiroz::entity::EndpointKind;
use hiroz::prelude::*;
use hiroz_msgs::example_interfaces::{AddTwoIntsRequest, AddTwoIntsResponse, srv::AddTwoInts};
use hiroz_msgs::sensor_msgs::Image;
use hiroz_msgs::std_msgs::String as Text;

/// How long a peer may take to be there.
const PATIENCE: Duration = Duration::from_secs(30);

fn main() -> Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [role, endpoint] = words.as_slice() else {
        return Err("expected a role and an endpoint".into());
    };
    let runtime = tokio::runtime::Runtime::new()?;
    let _entered = runtime.enter();
    let context = ZContextBuilder::default()
        .with_mode("peer")
        .disable_multicast_scouting()
        .with_connect_endpoints([endpoint.as_str()])
        .build()?;
    let node = context.create_node(&format!("hiroz_{role}")).build()?;
    match role.as_str() {
        "talker" => {
            let publisher = node.create_pub::<Text>("/chatter").build()?;
            if !runtime.block_on(publisher.wait_for_subscription(1, PATIENCE)) {
                return Err("no subscription has come".into());
            }
            for number in 1..=5 {
                publisher.publish(&Text { data: format!("number {number}") })?;
            }
            // Until the listener has left.
            while node.graph().count(EndpointKind::Subscription, "/chatter") > 0 {
                std::thread::sleep(Duration::from_millis(20));
            }
        }
        "listener" => {
            let subscription = node.create_sub::<Text>("/chatter").build()?;
            for _ in 0..5 {
                println!("{}", subscription.recv_timeout(PATIENCE)?.data);
            }
        }
        "server" => {
            let mut server = node.create_service::<AddTwoInts>("add_two_ints").build()?;
            for _ in 0..3 {
                let request = server.take_request()?;
                let sum = request.message().a + request.message().b;
                request.reply_blocking(&AddTwoIntsResponse { sum })?;
            }
        }
        "client" => {
            let client = node.create_client::<AddTwoInts>("add_two_ints").build()?;
            let begun = Instant::now();
            while node.graph().count(EndpointKind::Service, "/add_two_ints") == 0 {
                if begun.elapsed() > PATIENCE {
                    return Err("no service has come".into());
                }
                std::thread::sleep(Duration::from_millis(20));
            }
            for b in 0..3 {
                let request = AddTwoIntsRequest { a: 40, b };
                let response = runtime.block_on(client.call_with_timeout(&request, PATIENCE))?;
                println!("{}", response.sum);
            }
        }
        "camera" => {
            let publisher = node.create_pub::<Image>("/image").build()?;
            if !runtime.block_on(publisher.wait_for_subscription(1, PATIENCE)) {
                return Err("no subscription has come".into());
            }
            publisher.publish(&image())?;
            while node.graph().count(EndpointKind::Subscription, "/image") > 0 {
                std::thread::sleep(Duration::from_millis(20));
            }
        }
        "viewer" => {
            let subscription = node.create_sub::<Image>("/image").build()?;
            let image = subscription.recv_timeout(PATIENCE)?;
            let data = zenoh::bytes::ZBytes::from(image.data.into_inner());
            let bytes = data.to_bytes();
            let sum: u64 = bytes.iter().map(|byte| u64::from(*byte)).sum();
            let (width, height, encoding) = (image.width, image.height, image.encoding);
            println!("{width} x {height} {encoding} {} bytes that sum up to {sum}", bytes.len());
        }
        _ => return Err(format!("there is no role {role}").into()),
    }
    Ok(())
}

/// An image of 10 MB whose bytes are 0 to 255, again and again.
fn image() -> Image {
    let (width, height) = (2400, 1440);
    let data: Vec<u8> = (0..3 * width * height).map(|at| (at % 256) as u8).collect();
    Image {
        height,
        width,
        encoding: "rgb8".to_owned(),
        step: 3 * width,
        data: data.into(),
        ..Image::default()
    }
}
