//! A client of tailroad's service without any tailroad code: submits a job, follows it, reads its estimate.
//!
//!     cargo run --release -- ADDRESS BODY      ADDRESS: tcp/127.0.0.1:7447, BODY: a submission as JSON
//!
//! Prints the events as they come on standard error and the estimate on standard output. A refusal's problem (RFC 9457)
//! goes to standard error; the exit code is then 2. Keys and bodies: service/remote/api/README.md.

use serde_json::Value;
use std::time::{Duration, Instant};
use zenoh::{bytes::Encoding, Session, Wait};

const PREFIX: &str = "tailroad/v1";
const ANSWER: Duration = Duration::from_secs(20);
const LOOK: Duration = Duration::from_secs(1); // at the job itself, should an event have been missed

enum Failure {
    Refused(Value), // by the service, with its problem
    Other(String),
}

impl<E: std::error::Error> From<E> for Failure {
    fn from(error: E) -> Self {
        Failure::Other(error.to_string())
    }
}

/// The answer to a query on a key below PREFIX.
fn ask(session: &Session, selector: &str, body: Option<&str>) -> Result<Value, Failure> {
    let mut query = session.get(format!("{PREFIX}/{selector}")).timeout(ANSWER);
    if let Some(body) = body {
        query = query.payload(body).encoding(Encoding::APPLICATION_JSON);
    }
    let replies = query.wait().map_err(|e| Failure::Other(e.to_string()))?;
    match replies.recv() {
        Ok(reply) => match reply.into_result() {
            Ok(sample) => Ok(serde_json::from_slice(&sample.payload().to_bytes())?),
            Err(refusal) => Err(Failure::Refused(serde_json::from_slice(&refusal.payload().to_bytes())?)),
        },
        Err(_) => Err(Failure::Other(format!("nobody answers on {PREFIX}/{selector}"))),
    }
}

fn text<'a>(value: &'a Value, name: &str) -> &'a str {
    value[name].as_str().unwrap_or_default()
}

/// Until the job is over; its events go to standard error. The job's last status.
fn follow(session: &Session, job: &str) -> Result<String, Failure> {
    let events = session
        .declare_subscriber(format!("{PREFIX}/jobs/{job}/events"))
        .wait()
        .map_err(|e| Failure::Other(e.to_string()))?;
    let mut looked = Instant::now() - LOOK;
    loop {
        if let Ok(Some(sample)) = events.recv_timeout(LOOK) {
            let event: Value = serde_json::from_slice(&sample.payload().to_bytes())?;
            eprintln!("{}: {}", text(&event, "kind"), event["body"]);
        }
        if looked.elapsed() >= LOOK {
            looked = Instant::now();
            let state = ask(session, &format!("jobs/{job}"), None)?;
            if !["running", "paused"].contains(&text(&state, "status")) {
                return Ok(text(&state, "status").to_string());
            }
        }
    }
}

fn run(address: &str, body: &str) -> Result<(), Failure> {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"client\"".to_string()),
        ("connect/endpoints", format!("[\"{address}\"]")),
        ("scouting/multicast/enabled", "false".to_string()),
    ] {
        config.insert_json5(key, &value).map_err(|e| Failure::Other(e.to_string()))?;
    }
    let session = zenoh::open(config).wait().map_err(|e| Failure::Other(e.to_string()))?;
    let submitted = ask(&session, "jobs", Some(body))?;
    let job = text(&submitted, "id");
    eprintln!("job {job}");
    let status = follow(&session, job)?;
    if status != "done" {
        return Err(Failure::Other(format!("the job is {status}")));
    }
    println!("{}", ask(&session, &format!("jobs/{job}/estimate"), None)?);
    Ok(())
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [address, body] = arguments.as_slice() else {
        eprintln!("usage: tailroad-example-client ADDRESS BODY");
        std::process::exit(2);
    };
    match run(address, body) {
        Ok(()) => {}
        Err(Failure::Refused(problem)) => {
            eprintln!("{problem}");
            std::process::exit(2);
        }
        Err(Failure::Other(why)) => {
            eprintln!("{why}");
            std::process::exit(1);
        }
    }
}
