// Go's channels and goroutines in the scenarios of the benches.
//
// usage: go-peer SCENARIO OPERATIONS [SIZE]; prints the nanoseconds that the operations took, or bytes.
package main

import (
	"fmt"
	"os"
	"reflect"
	"runtime"
	"strconv"
	"sync"
	"time"
)

// warmUp returns how many operations precede the measurement.
func warmUp(operations int) int { return operations/16 + 1 }

// timed performs the operation so often, after a warm-up.
func timed(operations int, operation func()) float64 {
	for i := 0; i < warmUp(operations); i++ {
		operation()
	}
	start := time.Now()
	for i := 0; i < operations; i++ {
		operation()
	}
	return float64(time.Since(start).Nanoseconds())
}

func expect(value, expected uint64) {
	if value != expected {
		panic(fmt.Sprint(value, " instead of ", expected))
	}
}

func commstime(operations int, parallel bool) float64 {
	a, b, c, d := make(chan uint64), make(chan uint64), make(chan uint64), make(chan uint64)
	go func() {
		a <- 0
		for {
			a <- <-c
		}
	}()
	go func() {
		var both sync.WaitGroup
		for {
			x := <-a
			if parallel {
				both.Add(1)
				go func() { d <- x; both.Done() }()
				b <- x
				both.Wait()
			} else {
				d <- x
				b <- x
			}
		}
	}()
	go func() {
		for {
			c <- <-b + 1
		}
	}()
	var next uint64
	return timed(operations, func() {
		expect(<-d, next)
		next++
	})
}

func yielding(operations int) float64 {
	go func() {
		for {
			runtime.Gosched()
		}
	}()
	return timed(operations/2, runtime.Gosched)
}

// stream has one sender; its channel has so much room.
func stream(operations, capacity int) float64 {
	c := make(chan uint64, capacity)
	go func() {
		for i := uint64(0); ; i++ {
			c <- i
		}
	}()
	var next uint64
	return timed(operations, func() {
		expect(<-c, next)
		next++
	})
}

// alternative has a writer for each of its channels; `select` is written out for 8, and built by reflection for other numbers.
func alternative(operations, size int) float64 {
	channels := make([]chan uint64, size)
	cases := make([]reflect.SelectCase, size)
	counts := make([]uint64, size)
	for i := range channels {
		c := make(chan uint64)
		channels[i] = c
		cases[i] = reflect.SelectCase{Dir: reflect.SelectRecv, Chan: reflect.ValueOf(c)}
		go func() {
			for n := uint64(0); ; n++ {
				c <- n
			}
		}()
	}
	return timed(operations, func() {
		var chosen int
		var value uint64
		if size == 8 {
			select {
			case value = <-channels[0]:
				chosen = 0
			case value = <-channels[1]:
				chosen = 1
			case value = <-channels[2]:
				chosen = 2
			case value = <-channels[3]:
				chosen = 3
			case value = <-channels[4]:
				chosen = 4
			case value = <-channels[5]:
				chosen = 5
			case value = <-channels[6]:
				chosen = 6
			case value = <-channels[7]:
				chosen = 7
			}
		} else {
			i, received, _ := reflect.Select(cases)
			chosen, value = i, received.Uint()
		}
		expect(value, counts[chosen])
		counts[chosen]++
	})
}

// makeRing returns the two ends of an open ring of this many processes, the caller included.
func makeRing(size int) (chan uint64, chan uint64) {
	first := make(chan uint64)
	last := first
	for i := 1; i < size; i++ {
		in, out := last, make(chan uint64)
		go func() {
			for {
				out <- <-in + 1
			}
		}()
		last = out
	}
	return first, last
}

func ring(operations, size int) float64 {
	first, last := makeRing(size)
	laps := (operations + size - 1) / size
	elapsed := timed(laps, func() {
		first <- 0
		expect(<-last, uint64(size-1))
	})
	return elapsed * float64(operations) / float64(laps*size)
}

// memory returns the resident bytes of a process and its channel.
func memory(size int) float64 {
	resident := func() float64 {
		text, _ := os.ReadFile("/proc/self/statm")
		var all, pages float64
		fmt.Sscan(string(text), &all, &pages)
		return pages * float64(os.Getpagesize())
	}
	before := resident()
	first, last := makeRing(size)
	first <- 0
	expect(<-last, uint64(size-1))
	return (resident() - before) / float64(size)
}

func spawn(operations int) float64 {
	var end sync.WaitGroup
	return timed(operations, func() {
		end.Add(1)
		go end.Done()
		end.Wait()
	})
}

func main() {
	operations, _ := strconv.Atoi(os.Args[2])
	size := 0
	if len(os.Args) > 3 {
		size, _ = strconv.Atoi(os.Args[3])
	}
	var figure float64
	switch os.Args[1] {
	case "commstime":
		figure = commstime(operations, false)
	case "commstime-parallel":
		figure = commstime(operations, true)
	case "switch":
		figure = yielding(operations)
	case "rendezvous":
		figure = stream(operations, 0)
	case "buffered":
		figure = stream(operations, size)
	case "alternative":
		figure = alternative(operations, size)
	case "ring":
		figure = ring(operations, size)
	case "memory":
		figure = memory(size)
	case "spawn":
		figure = spawn(operations)
	default:
		panic("unknown scenario " + os.Args[1])
	}
	fmt.Println(figure)
}
