//! A black-box ego for tailroad: keeps its lane and its distance, and says so over Zenoh.
//!
//!     cargo run --release -- [NAME] [ADDRESS]        NAME: rust, ADDRESS: tcp/127.0.0.1:7447
//!     tailroad rollout i80-10s --ego zenoh:rust
//!
//! The conversation is the one of service/world/egos/README.md: hello, reset, observation, goodbye; a query each.

mod driver;

mod messages {
    include!(concat!(env!("OUT_DIR"), "/tailroad.ego.v1.rs"));
}

use messages::{action, reply, request, Action, Motion, Ready, Refusal, Reply, Request, Welcome};
use prost::Message;
use std::collections::HashSet;
use zenoh::Wait;

const VERSION: u32 = 1;

struct Service {
    instance: String,
    workers: HashSet<String>,
}

impl Service {
    /// The reply to a request; none to a goodbye.
    fn answer(&mut self, payload: &[u8]) -> Option<Reply> {
        let kind = match Request::decode(payload) {
            Ok(Request { kind: Some(kind) }) => kind,
            _ => return refuse("not a Request of ego.proto"),
        };
        match kind {
            request::Kind::Hello(hello) if hello.version != VERSION => {
                refuse(&format!("speaks version {VERSION} of ego.proto, not {}", hello.version))
            }
            request::Kind::Hello(_) => answer(reply::Kind::Welcome(Welcome {
                version: VERSION,
                instance: self.instance.clone(),
                sessions: self.workers.len() as u32,
                ..Default::default() // no pictures, no route
            })),
            request::Kind::Reset(reset) => {
                self.workers.insert(reset.worker);
                answer(reply::Kind::Ready(Ready { rollout: reset.rollout }))
            }
            request::Kind::Observation(seen) => {
                let (Some(ego), Some(lidar)) = (&seen.ego, &seen.lidar) else {
                    return refuse("an observation without ego or lidar");
                };
                let (acceleration_mps2, turn_rate_radps) = driver::drive(ego, lidar);
                let motion = Motion { acceleration_mps2, turn_rate_radps };
                answer(reply::Kind::Action(Action {
                    rollout: seen.rollout,
                    step: seen.step,
                    control: Some(action::Control::Motion(motion)),
                }))
            }
            request::Kind::Render(_) => refuse("an ego makes no pictures"),
            request::Kind::Goodbye(goodbye) => {
                self.workers.remove(&goodbye.worker);
                None
            }
        }
    }
}

fn answer(kind: reply::Kind) -> Option<Reply> {
    Some(Reply { kind: Some(kind) })
}

fn refuse(reason: &str) -> Option<Reply> {
    answer(reply::Kind::Refusal(Refusal { reason: reason.to_string() }))
}

fn main() -> zenoh::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let name = arguments.next().unwrap_or_else(|| "rust".to_string());
    let address = arguments.next().unwrap_or_else(|| "tcp/127.0.0.1:7447".to_string());

    let mut config = zenoh::Config::default();
    config.insert_json5("mode", "\"router\"")?;
    config.insert_json5("listen/endpoints", &format!("[\"{address}\"]"))?;
    config.insert_json5("scouting/multicast/enabled", "false")?;
    let session = zenoh::open(config).wait()?;

    let mut service = Service { instance: session.zid().to_string(), workers: HashSet::new() };
    let key = format!("tailroad/v1/egos/{name}/services/{}", service.instance);
    let queries = session.declare_queryable(&key).wait()?;
    let _life = session.liveliness().declare_token(&key).wait()?; // how workers know that we are here
    println!("ego service '{name}' is ready");

    while let Ok(query) = queries.recv() {
        let payload = query.payload().map(|p| p.to_bytes().into_owned()).unwrap_or_default();
        if let Some(reply) = service.answer(&payload) {
            query.reply(&key, reply.encode_to_vec()).wait()?;
        }
    }
    Ok(())
}
